"""Mapping: clouds and poses to a map of voxels, and a model that completes the map.

    found = map_recording(recording, load_model("jradar-maps"))
    found.enhanced.voxels, found.enhanced.probability

`VoxelMap` gathers the detections of many frames, `enhance_map` gives the voxels that a
LiDAR would have found, and `enhance_patch` does so for a patch of ColoRadar's maps.
"""

from jradar.mapping.loops import Loop as Loop, close_loops as close_loops
from jradar.mapping.predict import (
    Occupied as Occupied,
    best_count as best_count,
    column_grid as column_grid,
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
