"""Files of every format to `Recording`s."""

from jradar.recordings.bags import (
    LidarStream as LidarStream,
    bag_topics as bag_topics,
    open_bag as open_bag,
)
from jradar.recordings.capture import (
    accumulate as accumulate,
    open_capture as open_capture,
    read_tum as read_tum,
)
from jradar.recordings.clouds import (
    read_cloud as read_cloud,
    valid_points as valid_points,
    write_npz as write_npz,
    write_ply as write_ply,
)
from jradar.recordings.coloradar import (
    Imu as Imu,
    coloradar_clouds as coloradar_clouds,
    coloradar_heatmaps as coloradar_heatmaps,
    coloradar_imu as coloradar_imu,
    coloradar_lidar as coloradar_lidar,
    coloradar_poses as coloradar_poses,
    open_coloradar as open_coloradar,
)
from jradar.recordings.coloradar_calib import (
    FrequencyPhase as FrequencyPhase,
    radar_from_coloradar as radar_from_coloradar,
    read_coupling as read_coupling,
    read_frequency_phase as read_frequency_phase,
)
from jradar.recordings.cubes import open_recording as open_recording
from jradar.recordings.dca1000 import open_dca1000 as open_dca1000
from jradar.recordings.describe import (
    describe as describe,
    describe_file as describe_file,
)
from jradar.recordings.iq_order import advise_iq_order as advise_iq_order
from jradar.recordings.recording import (
    Recording as Recording,
    Stream as Stream,
    calibrated_cube as calibrated_cube,
    nearest_scan as nearest_scan,
    radar_from_lidar as radar_from_lidar,
)
from jradar.recordings.studio_log import radar_from_studio_log as radar_from_studio_log
from jradar.recordings.text_files import radar_from_toml as radar_from_toml
from jradar.recordings.ti_cfg import (
    CaptureSpec as CaptureSpec,
    radar_from_cfg as radar_from_cfg,
)
from jradar.recordings.time_offset import (
    estimate_time_offset as estimate_time_offset,
    propose_offset as propose_offset,
    radar_speed as radar_speed,
)
