"""Files and simulations to frames, and frames to training pairs.

open_recording                   a file or folder of any format, as a Recording
calibrated_cube, nearest_scan    what a recording knows of a frame
describe, describe_file          what it holds, for people and scripts
open_coloradar                   a sequence of ColoRadar; beside its radar, coloradar_
 .. lidar, imu, poses, clouds, heatmaps
SEQUENCES, scene, paper_split    ColoRadar's 52, as the paper divides them
open_dca1000, advise_iq_order    captures of TI's DCA1000 card
open_bag, bag_topics             LiDAR clouds in ROS bags
open_capture                     both, poses and extrinsics: a capture of one's own
estimate_time_offset, propose_offset                 between the sensors' clocks
prepare, PrepareSpec             recordings to records of training pairs
 .. prepare_frame, matches_of     one frame of them, and which belong together
find_sources                     the recordings below a folder, and their splits
Records, PairSource, Batches     records to images, and to batches by step (mirrored)
open_radarhd                     RadarHD's pairs of polar images
simulation                       a ColoRadar that the project makes itself
read_cloud                       clouds from PCD, PLY and KITTI files
write_ply, write_npz             clouds to files
"""

from jradar.data.capture import (
    accumulate as accumulate,
    open_capture as open_capture,
    read_tum as read_tum,
)
from jradar.data.clouds import (
    read_cloud as read_cloud,
    valid_points as valid_points,
    write_npz as write_npz,
    write_ply as write_ply,
)
from jradar.data.coloradar import (
    Imu as Imu,
    coloradar_clouds as coloradar_clouds,
    coloradar_heatmaps as coloradar_heatmaps,
    coloradar_imu as coloradar_imu,
    coloradar_lidar as coloradar_lidar,
    coloradar_poses as coloradar_poses,
    open_coloradar as open_coloradar,
)
from jradar.data.coloradar_splits import (
    SEQUENCES as SEQUENCES,
    paper_split as paper_split,
    scene as scene,
)
from jradar.data.cubes import open_recording as open_recording
from jradar.data.dca1000 import open_dca1000 as open_dca1000
from jradar.data.frames import (
    PrepareSpec as PrepareSpec,
    matches_of as matches_of,
    prepare_frame as prepare_frame,
)
from jradar.data.inspect import describe as describe, describe_file as describe_file
from jradar.data.iq_order import advise_iq_order as advise_iq_order
from jradar.data.loading import (
    Batches as Batches,
    Pair as Pair,
    PairSource as PairSource,
    lidar_image as lidar_image,
    mirrored as mirrored,
)
from jradar.data.matching import (
    Matches as Matches,
    match_nearest as match_nearest,
)
from jradar.data.preparation import prepare as prepare
from jradar.data.radarhd import RadarHD as RadarHD, open_radarhd as open_radarhd
from jradar.data.recording import (
    Recording as Recording,
    Stream as Stream,
    calibrated_cube as calibrated_cube,
    nearest_scan as nearest_scan,
    radar_from_lidar as radar_from_lidar,
)
from jradar.data.records import (
    PreparedFrame as PreparedFrame,
    Records as Records,
)
from jradar.data.rosbags import (
    LidarStream as LidarStream,
    bag_topics as bag_topics,
    open_bag as open_bag,
)
from jradar.data.sources import Source as Source, find_sources as find_sources
from jradar.data.time_offset import (
    estimate_time_offset as estimate_time_offset,
    propose_offset as propose_offset,
    radar_speed as radar_speed,
)
