"""Files of any format to `Recording`s: radar frames, scans, poses, calibration.

    open_recording, is_recording     the recording at a path, of any format in READERS
    Recording, Stream, Imu           what readers return; frames are read when accessed
    without_background               the recording without what stands still
    nearest_scan, radar_from_lidar   the LiDAR scan of a frame, in the radar's frame
    describe, describe_file          what a recording, a bag or a cloud holds
    check_samples                    clipped, or in another byte order or code

Formats, each with its layout at the top of its module:

    open_coloradar                   `coloradar`: sequences of the public data set
    open_dca1000                     `dca1000`: samples of TI's capture card
    open_packet_trace                `packet_trace`: the same in a .pcap
    open_raw_bag                     `bags.raw`: the same in ROS bags
    open_npy                         `cubes`: complex arrays
    open_capture, read_tum           `capture`: a rig's radar, LiDAR and poses
    open_bag, bag_topics             `bags`: LiDAR clouds in ROS 1 and ROS 2 bags
    open_imu                         `bags.imu`: IMUs in bags
    read_cloud                       `clouds`: PLY, PCD, KITTI
    CLOUD_WRITERS, write_npz         `clouds.write`: a cloud's valid points

Radars and their calibration:

    read_description                 a radar in a .toml, .cfg, log or calib folder
    read_radar_toml, write_radar_toml    `radar_toml`: a radar and its calibration
    radar_from_toml, .. _cfg, .. _studio_log, .. _coloradar
    read_coupling, read_frequency_phase
    estimate_time_offset, propose_offset    the time between radar and LiDAR clocks

`recording` explains how to add a format.
"""

from jradar.recordings.background import without_background as without_background
from jradar.recordings.bags.bags import bag_topics as bag_topics, open_bag as open_bag
from jradar.recordings.bags.imu import open_imu as open_imu
from jradar.recordings.bags.raw import open_raw_bag as open_raw_bag
from jradar.recordings.capture import (
    accumulate as accumulate,
    open_capture as open_capture,
)
from jradar.recordings.clouds.read import read_cloud as read_cloud
from jradar.recordings.clouds.write import (
    CLOUD_WRITERS as CLOUD_WRITERS,
    valid_points as valid_points,
    write_npz as write_npz,
    write_ply as write_ply,
)
from jradar.recordings.coloradar.calib import (
    radar_from_coloradar as radar_from_coloradar,
    read_coupling as read_coupling,
    read_frequency_phase as read_frequency_phase,
)
from jradar.recordings.coloradar.sequence import open_coloradar as open_coloradar
from jradar.recordings.cubes import open_npy as open_npy
from jradar.recordings.describe import (
    describe as describe,
    describe_file as describe_file,
)
from jradar.recordings.descriptions import read_description as read_description
from jradar.recordings.open import (
    is_recording as is_recording,
    open_recording as open_recording,
)
from jradar.recordings.radar_toml import (
    read_radar_toml as read_radar_toml,
    write_radar_toml as write_radar_toml,
)
from jradar.recordings.recording import (
    Imu as Imu,
    Recording as Recording,
    Stream as Stream,
    nearest_scan as nearest_scan,
    radar_from_lidar as radar_from_lidar,
)
from jradar.recordings.sample_checks import (
    check_samples as check_samples,
    sample_doubts as sample_doubts,
    with_sample_doubts as with_sample_doubts,
)
from jradar.recordings.text_files import (
    radar_from_toml as radar_from_toml,
    read_tum as read_tum,
)
from jradar.recordings.ti.cfg import radar_from_cfg as radar_from_cfg
from jradar.recordings.ti.dca1000 import open_dca1000 as open_dca1000
from jradar.recordings.ti.frame import CaptureSpec as CaptureSpec
from jradar.recordings.ti.packet_trace import open_packet_trace as open_packet_trace
from jradar.recordings.ti.studio_log import (
    radar_from_studio_log as radar_from_studio_log,
)
from jradar.recordings.time_offset import (
    estimate_time_offset as estimate_time_offset,
    propose_offset as propose_offset,
)
