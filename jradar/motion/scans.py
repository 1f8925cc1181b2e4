"""Poses from LiDAR scans, by KISS-ICP (Vizzo et al. 2023); host.

Scans are matched as they are, without undoing the motion within them: their readers
return no times of points. Their poses are those of the middle of each scan.
"""

import numpy as np
import scipy  # loads `spatial` when it is first used
from jaxtyping import Float

from jradar.errors import UsageError, optional
from jradar.lidar import Poses, returns
from jradar.motion.attitude import gyro_attitude
from jradar.recordings import Recording

MAX_RANGE_M = 50.0
SCAN_S = 0.1  # of a scan, unless the next one begins earlier
LARGEST_DPS = 10.0  # by which rates of rotation may differ from a gyroscope's, rms


def scan_poses(recording: Recording) -> Poses:
    """Return poses of the base, the first as origin, in the middle of each LiDAR scan.

    The times of scans are taken as those of their first points. Raises UsageError
    without scans, their times or the LiDAR's place, ImportError without kiss-icp (the
    extra `odometry`), and ValueError for poses that the recording's gyroscope
    contradicts.
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
    found = to_poses(stamps + middle, np.array(poses))
    _check_rotation(recording, found)
    return found


def _check_rotation(recording: Recording, poses: Poses) -> None:
    """Raise ValueError if the rotation from pose to pose is not the gyroscope's."""
    if (imu := recording.imu) is None or recording.base_from_imu is None:
        return
    covered = (poses.stamps >= imu.stamps[0]) & (poses.stamps <= imu.stamps[-1])
    stamps = poses.stamps[covered]
    if len(stamps) < 2:
        return
    turned = gyro_attitude(imu, stamps, recording.base_from_imu)
    of = scipy.spatial.transform.Rotation
    steps = [
        turns[:-1].inv() * turns[1:]
        for turns in (of.from_matrix(turned), of.from_quat(poses.quaternion[covered]))
    ]
    apart = np.degrees((steps[0].inv() * steps[1]).magnitude()) / np.diff(stamps)
    if (off := float(np.sqrt(np.mean(apart**2)))) > LARGEST_DPS:
        raise ValueError(
            f"{recording.path}: matched scans and the gyroscope rotate differently, by "
            f"{off:.0f} degrees a second (rms), expected at most {LARGEST_DPS:.0f}: "
            "scan matching failed, as in corridors where a LiDAR sees little, or "
            "the place of the LiDAR or the IMU is wrong. Name recorded poses in "
            "capture.toml, or walk where there are surfaces all around"
        )


def to_poses(
    stamps: Float[np.ndarray, " stamp"], matrices: Float[np.ndarray, "stamp 4 4"]
) -> Poses:
    """Return transforms as `Poses`."""
    turns = scipy.spatial.transform.Rotation.from_matrix(matrices[:, :3, :3]).as_quat()
    return Poses(stamps, matrices[:, :3, 3], turns)
