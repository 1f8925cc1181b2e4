"""A trajectory in words and numbers, as `jradar odometry` prints it."""

from typing import Any

import numpy as np

from jradar.lidar import Poses
from jradar.motion.trajectory import Trajectory, compare
from jradar.motion.velocities import Velocities


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
    errors = None if poses is None else compare(trajectory, poses)
    if errors is not None:
        found |= {
            "frames with a pose": errors.frames,
            "true distance (m)": errors.distance_m,
            "APE (m)": errors.positions._asdict(),
            "RPE (m)": errors.steps._asdict(),
            "RPE (deg)": errors.turns._asdict(),
        }
    return found
