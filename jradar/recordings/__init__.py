"""Files of any format to `Recording`s: radar frames or points, scans, poses.

    recording = open_recording("walk.mcap")   # or a folder, a .npy, an adc_data.bin
    cube, radar = recording.cube(0), recording.radar
    cloud = recording.points[0]               # of a radar that sends points
    scan = nearest_scan(recording, 0)         # in the radar's frame, if it has one
    columns = read_cloud("frame.ply")

Each format has a module, with its layout at the top. `recording` explains how to add
one. Nothing here imports JAX before the first `Radar` is made.
"""

from jradar.recordings.bags.radar_frames import (
    describes_its_radar as describes_its_radar,
)
from jradar.recordings.clouds.read import read_cloud as read_cloud
from jradar.recordings.coloradar.calib import read_coupling as read_coupling
from jradar.recordings.configuration import (
    describe_configuration as describe_configuration,
)
from jradar.recordings.describe import (
    describe as describe,
    describe_file as describe_file,
)
from jradar.recordings.descriptions import (
    is_description as is_description,
    read_description as read_description,
)
from jradar.recordings.frame_recorder import (
    open_recorder as open_recorder,
)
from jradar.recordings.open import (
    holds_points as holds_points,
    is_recording as is_recording,
    open_recording as open_recording,
    recordings_in as recordings_in,
    without_background as without_background,
)
from jradar.recordings.radar_toml import write_radar_toml as write_radar_toml
from jradar.recordings.recording import (
    Imu as Imu,
    Recording as Recording,
    Stream as Stream,
    nearest_scan as nearest_scan,
    need_samples as need_samples,
    radar_from_lidar as radar_from_lidar,
)
from jradar.recordings.sample_checks import (
    check_samples as check_samples,
    with_sample_warnings as with_sample_warnings,
)
from jradar.recordings.text_files import read_tum as read_tum
