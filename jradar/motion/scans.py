"""Poses from LiDAR scans, by KISS-ICP (Vizzo et al. 2023); host.

Scans are matched as they are, without undoing the motion within them: their readers
return no times of points.
"""

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from jradar.errors import UsageError
from jradar.lidar import Poses, returns
from jradar.recordings import Recording


def scan_poses(recording: Recording, *, max_range_m: float = 50.0) -> Poses:
    """Return poses of the base, the first as origin, at the times of the LiDAR's scans.

    Raises UsageError without scans, their times or the LiDAR's place, and ImportError
    without kiss-icp (the extra `odometry`).
    """
    lidar, mount = recording.lidar, recording.base_from_lidar
    if lidar is None or lidar.stamps is None or mount is None or len(lidar) < 2:
        raise UsageError(
            f"{recording.path}: scan matching needs LiDAR scans, their times and the "
            "LiDAR's place on the base"
        )
    odometry, poses = _kiss_icp(max_range_m), []
    for k in range(len(lidar)):
        xyz = lidar[k][:, :3]
        odometry.register_frame(np.float64(xyz[returns(xyz)]), np.zeros(0))
        poses.append(mount @ odometry.last_pose @ np.linalg.inv(mount))
    matrices = np.array(poses)
    turns = Rotation.from_matrix(matrices[:, :3, :3]).as_quat()
    return Poses(np.asarray(lidar.stamps), matrices[:, :3, 3], turns)


def _kiss_icp(max_range_m) -> Any:
    try:
        from kiss_icp.config import KISSConfig
        from kiss_icp.kiss_icp import KissICP
    except ImportError as error:
        raise ImportError(
            "scan matching needs kiss-icp: pip install 'jradar[odometry]'"
        ) from error
    config = KISSConfig()
    config.data.max_range, config.data.deskew = max_range_m, False
    config.mapping.voxel_size = max_range_m / 100
    return KissICP(config)
