"""Ground truth that the radar could have seen; host NumPy (section V-A.3).

Poses, rigid_transform, transform    where sensors are, and clouds in another frame
interpolate_poses, accumulate        a trajectory at other times; scans in one frame
returns, shared_field_of_view        points that are echoes, and where a radar looks
floor_plane, ground_mask             the floor: Patchwork++ on the levelled cloud
ceiling_mask                         the same upside down
voxel_filter, visible_mask           clusters of both clouds that the radar saw
LidarSpec, preprocess, LidarSteps    all of it on one scan, step by step
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
