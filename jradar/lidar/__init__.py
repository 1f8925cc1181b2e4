"""Ground truth that the radar could have seen; host NumPy (section V-A.3).

Poses, rigid_transform, transform    where sensors are, and clouds in another frame
interpolate_poses                    a trajectory at other times
"""

from jradar.lidar.align import (
    Poses as Poses,
    interpolate_poses as interpolate_poses,
    rigid_transform as rigid_transform,
    transform as transform,
)
