"""A trajectory in words and numbers, as `jradar odometry` prints it."""

from typing import Any

import numpy as np

from jradar.lidar import Poses, interpolate_poses
from jradar.motion.errors import position_errors, step_errors
from jradar.motion.trajectory import Trajectory
from jradar.motion.velocities import Velocities

LEAST_POSES = 3  # to compare


def describe_trajectory(
    trajectory: Trajectory, velocities: Velocities, poses: Poses | None
) -> dict[str, Any]:
    """Return speed and distance, and errors where recorded poses cover the frames."""
    speed = np.linalg.norm(velocities.velocity, axis=1)
    deviation = np.sqrt(np.diagonal(velocities.covariance, axis1=1, axis2=2))
    points = np.maximum(velocities.points, 1)
    found: dict[str, Any] = {
        "frames used": len(speed),
        "frames with a velocity": int(np.isfinite(speed).sum()),
        "inliers": float(np.mean(velocities.inliers / points)),
        "echoes that move or are ghosts": float(np.mean(velocities.moving / points)),
        "speed": {
            "median (m/s)": float(np.nanmedian(speed)),
            "largest (m/s)": float(np.nanmax(speed)),
            "deviation forward (m/s)": float(np.median(deviation[:, 0])),
            "deviation to the left (m/s)": float(np.median(deviation[:, 1])),
        },
        "distance (m)": trajectory.distance_m,
    }
    if poses is None:
        return found
    true = interpolate_poses(poses, trajectory.stamps)
    covered = np.isfinite(true).all((1, 2))
    if covered.sum() < LEAST_POSES:
        return found
    estimated, true = trajectory.world_from_base[covered], true[covered]
    steps = np.linalg.norm(np.diff(true[:, :3, 3], axis=0), axis=1)
    metres, degrees = step_errors(estimated, true)
    return found | {
        "frames with a pose": int(covered.sum()),
        "true distance (m)": float(steps.sum()),
        "APE (m)": position_errors(estimated, true)._asdict(),
        "RPE (m)": metres._asdict(),
        "RPE (deg)": degrees._asdict(),
    }
