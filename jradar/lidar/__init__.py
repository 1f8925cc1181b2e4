"""Ground truth that the radar could have seen; host NumPy (section V-A.3).

Poses         Poses, rigid_transform, transform, interpolate_poses
Scans         returns (points that are echoes), accumulate, shared_field_of_view
All steps     LidarSpec, preprocess, LidarSteps; aligned, the first of them

The steps are in `ground` (floor and ceiling by Patchwork++) and `visible` (clusters of
both sensors).
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
from jradar.lidar.preprocess import (
    LidarSpec as LidarSpec,
    LidarSteps as LidarSteps,
    aligned as aligned,
    preprocess as preprocess,
)
