"""Poses from LiDAR scans, by KISS-ICP (Vizzo et al. 2023); host.

Scans are matched as they are, without undoing the motion within them: their readers
return no times of points. Their poses are those of the middle of each scan.
"""

import numpy as np
import scipy  # loads `spatial` when it is first used
from jaxtyping import Float

from jradar.errors import UsageError, optional
from jradar.lidar import Poses, returns
from jradar.recordings import Recording

MAX_RANGE_M = 50.0
SCAN_S = 0.1  # of a scan, unless the next one begins earlier


def scan_poses(recording: Recording) -> Poses:
    """Return poses of the base, the first as origin, in the middle of each LiDAR scan.

    The times of scans are taken as those of their first points. Raises UsageError
    without scans, their times or the LiDAR's place, and ImportError without kiss-icp
    (the extra `odometry`).
    """
    lidar, mount = recording.lidar, recording.base_from_lidar
    if lidar is None or lidar.stamps is None or mount is None or len(lidar) < 2:
        raise UsageError(
            f"{recording.path}: scan matching needs LiDAR scans, their times and the "
            "LiDAR's place on the base"
        )
    options = {"need": "scan matching needs kiss-icp", "extra": "odometry"}
    config = optional("kiss_icp.config", **options).KISSConfig()
    config.data.max_range, config.data.deskew = MAX_RANGE_M, False
    config.mapping.voxel_size = MAX_RANGE_M / 100
    odometry, poses = optional("kiss_icp.kiss_icp", **options).KissICP(config), []
    for k in range(len(lidar)):
        xyz = lidar[k][:, :3]
        odometry.register_frame(np.float64(xyz[returns(xyz)]), np.zeros(0))
        poses.append(mount @ odometry.last_pose @ np.linalg.inv(mount))
    stamps = np.asarray(lidar.stamps)
    middle = 0.5 * min(float(np.median(np.diff(stamps))), SCAN_S)
    return to_poses(stamps + middle, np.array(poses))


def to_poses(
    stamps: Float[np.ndarray, " stamp"], matrices: Float[np.ndarray, "stamp 4 4"]
) -> Poses:
    """Return transforms as `Poses`."""
    turns = scipy.spatial.transform.Rotation.from_matrix(matrices[:, :3, :3]).as_quat()
    return Poses(stamps, matrices[:, :3, 3], turns)
