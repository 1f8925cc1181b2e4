"""Mapping: clouds and poses to a map of voxels, and a model that completes the map.

VoxelMap, SensorModel              detections of many frames to log-odds of voxels
MapModel, load_map_model, save_map_model
                                   a network that gives each voxel's probability
map_recording, map_clouds, map_files
                                   a recording, or clouds with poses, to maps; files
enhance_map, expected              a radar's map -> the voxels that a LiDAR would find
enhance_patch, nearest, best_count the same for a patch, in ColoRadar's sense
MapRun, open_runs                  ColoRadar's maps of radar and LiDAR
MapSpec, TileSpec, Tiles           images of them for training
published_distance                 UpPoinTr's, for scores of patches
"""

from jradar.mapping.columns import MapSpec as MapSpec
from jradar.mapping.model import (
    MapModel as MapModel,
    load_map_model as load_map_model,
    save_map_model as save_map_model,
)
from jradar.mapping.predict import (
    Occupied as Occupied,
    best_count as best_count,
    enhance_map as enhance_map,
    enhance_patch as enhance_patch,
    expected as expected,
    nearest as nearest,
)
from jradar.mapping.recording import (
    FILES as FILES,
    RecordingMap as RecordingMap,
    map_clouds as map_clouds,
    map_files as map_files,
    map_recording as map_recording,
    radar_poses as radar_poses,
)
from jradar.mapping.scores import published_distance as published_distance
from jradar.mapping.tiles import Tiles as Tiles, TileSpec as TileSpec
from jradar.mapping.voxel_map import (
    SensorModel as SensorModel,
    VoxelMap as VoxelMap,
)
from jradar.recordings.coloradar.maps import (
    PATCH_VOXELS as PATCH_VOXELS,
    MapRun as MapRun,
    open_runs as open_runs,
)
