"""`jradar odometry`: a recording's Doppler to the trajectory of its radar."""

import argparse
import dataclasses
from typing import Any

import numpy as np

from jradar.cli.reading import given, opening, summary
from jradar.errors import UsageError
from jradar.lidar import interpolate_poses
from jradar.motion import (
    Trajectory,
    Velocities,
    frame_velocities,
    odometry,
    position_errors,
    step_errors,
    write_tum,
)
from jradar.motion.velocities import POINTS
from jradar.progress import progress
from jradar.recordings import Recording, open_recording, with_sample_doubts

LEAST_POSES = 3


def odometry_of_recording(options: argparse.Namespace) -> dict[str, Any]:
    """Write the trajectory; return velocities, distance and errors."""
    recording = open_recording(options.path, **opening(options))
    count = len(recording.cubes)
    frames = range(*options.frames.indices(count))
    if len(frames) < 2:
        raise UsageError(
            f"{options.path}: {len(frames)} of frames 0 to {count - 1}, expected 2 or "
            "more to move between"
        )
    recording = with_sample_doubts(recording, frames[0])
    spec = dataclasses.replace(POINTS, **given(options, "folds"))
    with progress("odometry", len(frames), unit="frames") as show:
        velocities = frame_velocities(
            recording, frames=frames, points=spec, advance=show
        )
    rotation = options.rotation or ("none" if recording.imu is None else "imu")
    found = odometry(recording, velocities, rotation=rotation)
    write_tum(options.output, found)
    return {
        **summary(recording, (*_doubts(recording, velocities), *found.notes)),
        "rotation": rotation,
        "frames used": len(frames),
        "frames with a velocity": int(np.isfinite(velocities.velocity[:, 0]).sum()),
        "inliers": _share(velocities.inliers, velocities.points),
        "echoes that move or are ghosts": _share(velocities.moving, velocities.points),
        "speed": _speeds(velocities),
        "distance (m)": found.distance_m,
        **_errors(recording, found),
        "written": [options.output],
    }


def _doubts(recording: Recording, velocities: Velocities):
    """Yield what is doubtful about the velocities."""
    missing = np.flatnonzero(~np.isfinite(velocities.velocity[:, 0]))
    if len(missing):
        yield (
            f"no velocity in {len(missing)} of {len(velocities.stamps)} frames, which "
            "are bridged"
        )
    if not recording.radar.spec.has_elevation:
        yield "the array has one row: the radar is taken to move in its own plane"


def _share(part, whole) -> float:
    """The mean share of a frame's points."""
    return float(np.mean(part / np.maximum(whole, 1)))


def _speeds(velocities: Velocities) -> dict[str, float]:
    speed = np.linalg.norm(velocities.velocity, axis=1)
    deviation = np.sqrt(np.diagonal(velocities.covariance, axis1=1, axis2=2)[:, :2])
    return {
        "median (m/s)": float(np.nanmedian(speed)),
        "largest (m/s)": float(np.nanmax(speed)),
        "deviation forward (m/s)": float(np.median(deviation[:, 0])),
        "deviation to the left (m/s)": float(np.median(deviation[:, 1])),
    }


def _errors(recording: Recording, found: Trajectory) -> dict[str, Any]:
    """APE and RPE in the frames that the recorded poses cover."""
    if recording.poses is None:
        return {}
    true = interpolate_poses(recording.poses, found.stamps)
    covered = np.isfinite(true).all((1, 2))
    if covered.sum() < LEAST_POSES:
        return {}
    estimated, true = found.world_from_base[covered], true[covered]
    metres, degrees = step_errors(estimated, true)
    steps = np.diff(true[:, :3, 3], axis=0)
    return {
        "frames with a pose": int(covered.sum()),
        "true distance (m)": float(np.linalg.norm(steps, axis=1).sum()),
        "APE (m)": position_errors(estimated, true)._asdict(),
        "RPE (m)": metres._asdict(),
        "RPE (deg)": degrees._asdict(),
    }
