"""Files of any format to `Recording`s: radar frames, scans, poses, calibration.

    open_recording, is_recording     the recording at a path, of any format in READERS
    Recording, Stream, Imu           what readers return; frames are read when accessed
    without_background               the recording without what stands still
    nearest_scan, radar_from_lidar   the LiDAR scan of a frame, in the radar's frame
    describe, describe_file          what a recording, a bag or a cloud holds
    describe_radar                   what a radar measures
    check_samples                    clipped, or in another byte order or code

    read_description                 a radar in a .toml, .cfg, log or calib folder
    write_radar_toml, read_coupling  a radar and its calibration; ColoRadar's leakage
    read_cloud, read_tum             clouds in PLY, PCD or KITTI's files; poses
    open_recorder, FrameRecorder     frames as they come from the cable, as a recording
    BagRecorder, describes_its_radar   the same in one MCAP file
    CLOUD_WRITERS, write_npz         a cloud's valid points, which `point_table` lists

Each format has a module, with its layout at the top. `recording` explains how to add
one.
"""

from jradar.recordings.bags.radar_clouds import (
    RadarClouds as RadarClouds,
    holds_radar_clouds as holds_radar_clouds,
    open_radar_clouds as open_radar_clouds,
)
from jradar.recordings.bags.radar_frames import (
    BagRecorder as BagRecorder,
    describes_its_radar as describes_its_radar,
)
from jradar.recordings.clouds.read import read_cloud as read_cloud
from jradar.recordings.clouds.write import (
    CLOUD_WRITERS as CLOUD_WRITERS,
    point_table as point_table,
    save_cloud as save_cloud,
    valid_points as valid_points,
    write_npz as write_npz,
    write_ply as write_ply,
)
from jradar.recordings.coloradar.calib import read_coupling as read_coupling
from jradar.recordings.configuration import (
    describe_configuration as describe_configuration,
)
from jradar.recordings.describe import (
    describe as describe,
    describe_file as describe_file,
    describe_radar as describe_radar,
)
from jradar.recordings.descriptions import (
    is_description as is_description,
    read_description as read_description,
)
from jradar.recordings.frame_recorder import (
    FrameRecorder as FrameRecorder,
    open_recorder as open_recorder,
)
from jradar.recordings.open import (
    is_recording as is_recording,
    open_recording as open_recording,
    without_background as without_background,
)
from jradar.recordings.radar_toml import write_radar_toml as write_radar_toml
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
from jradar.recordings.text_files import read_tum as read_tum
