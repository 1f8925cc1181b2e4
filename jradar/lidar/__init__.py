"""Ground truth that the radar could have seen; host NumPy (section V-A.3).

Poses         Poses, rigid_transform, transform, interpolate_poses
Scans         returns (points that are echoes), accumulate, shared_field_of_view
Floor         floor_plane, ground_mask, ceiling_mask         Patchwork++
Visibility    visible_mask, voxel_filter                     clusters of both sensors
All steps     LidarSpec, preprocess, LidarSteps
"""

from jradar.lidar.align import (
    Poses as Poses,
    accumulate as accumulate,
    interpolate_poses as interpolate_poses,
    returns as returns,
    rigid_transform as rigid_transform,
    shared_field_of_view as shared_field_of_view,
    transform as transform,
)
from jradar.lidar.ground import (
    Plane as Plane,
    ceiling_mask as ceiling_mask,
    floor_plane as floor_plane,
    ground_mask as ground_mask,
)
from jradar.lidar.preprocess import (
    LidarSpec as LidarSpec,
    LidarSteps as LidarSteps,
    preprocess as preprocess,
)
from jradar.lidar.visible import (
    visible_mask as visible_mask,
    voxel_filter as voxel_filter,
)
