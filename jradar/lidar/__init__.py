"""Ground truth that the radar could have seen; host NumPy (section V-A.3).

    seen = preprocess(scan, echoes, radar_from_lidar=matrix, spec=LidarSpec())
    truth = seen.xyz[seen.visible]

The steps are in `align` (one frame and one view), `ground` (floor and ceiling by
Patchwork++) and `visible` (clusters of both sensors).
"""

from jradar.lidar.align import (
    Poses as Poses,
    interpolate_poses as interpolate_poses,
    returns as returns,
    rigid_transform as rigid_transform,
    shared_field_of_view as shared_field_of_view,
    transform as transform,
)
from jradar.lidar.preprocess import (
    LidarSpec as LidarSpec,
    preprocess as preprocess,
)
