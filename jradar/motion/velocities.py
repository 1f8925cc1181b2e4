"""The radar's own velocity in each frame of a recording."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from jradar.errors import UsageError
from jradar.motion.doppler import ego_velocity
from jradar.radar import PointSpec, radar_points
from jradar.recordings import Recording
from jradar.types import PointCloud

POINTS = PointSpec(capacity=512)
NEIGHBOURS_S = 0.4  # before and after a frame
LEAST_NEIGHBOURS = 5
OUTLIER_MPS, OUTLIER_DEVIATIONS = 0.5, 4.0  # from the neighbours' median: both
TO_DEVIATION = 1.4826  # of a Gaussian, over the median absolute deviation


class Velocities(NamedTuple):
    """Velocities along the radar's axes; NaN in frames without one."""

    stamps: Float[np.ndarray, " frame"]  # seconds, in the middle of the frame
    velocity: Float[np.ndarray, "frame 3"]  # m/s
    covariance: Float[np.ndarray, "frame 3 3"]  # (m/s)^2; infinite without a velocity
    points: Int[np.ndarray, " frame"]
    inliers: Int[np.ndarray, " frame"]
    moving: Int[np.ndarray, " frame"]


def frame_velocities(
    recording: Recording,
    *,
    frames: Sequence[int] | None = None,
    points: PointSpec | None = None,
    advance: Callable[[int], None] = lambda done: None,
) -> Velocities:
    """Return the radar's velocity in each of `frames`, by default in all; host.

    The velocities of points that a radar sends are taken as unambiguous. With
    `points.folds`, those of samples are found beyond the unambiguous one, too.
    `advance` is called with the number of frames done. Raises UsageError if the frames
    have no times or no Doppler.
    """
    stamps = recording.frames.stamps
    chosen = range(len(recording.frames)) if frames is None else frames
    if stamps is None or not len(chosen):
        fix = "set frame_period_s, or name the frames' stamps"
        if recording.of_points:
            fix = "add a column `timestamp`, or poses next to the file"
        raise UsageError(
            f"{recording.path}: {len(chosen)} frames, expected some with known times: "
            f"{fix}"
        )
    measured = _sent if recording.of_points else _detected(recording, points)
    key, rows = jax.random.key(0), []
    elevation = recording.has_elevation
    for done, frame in enumerate(chosen, 1):
        cloud, limit = measured(recording, frame)
        found = ego_velocity(
            jax.random.fold_in(key, frame),
            cloud,
            elevation=elevation,
            unambiguous_mps=limit,
            folds=0,
        )
        counts = (mask.sum() for mask in (cloud.valid, found.inliers, found.moving))
        rows.append((found.velocity, found.covariance, *counts))
        advance(done)
    return _velocities(stamps[list(chosen)] + recording.frame_middle_s, rows)


Measured = tuple[PointCloud, float | None]  # points, and their unambiguous velocity


def _sent(recording: Recording, frame: int) -> Measured:
    """Return the points of a frame; UsageError if they have no velocity."""
    cloud = recording.frames[frame]
    if cloud.velocity is None:
        raise UsageError(
            f"{recording.path}: the points have no Doppler velocity, from which the "
            "radar's own would follow"
        )
    return PointCloud(cloud.xyz, cloud.valid, cloud.velocity).padded(), None


def _detected(
    recording: Recording, points: PointSpec | None
) -> Callable[[Recording, int], Measured]:
    """Return the function that detects the points of a frame's samples."""
    radar = recording.radar.spec
    if radar.num_chirps < 2 or not radar.has_azimuth:
        raise UsageError(
            f"{radar.name} sends {radar.num_chirps} chirps a frame to an array of "
            f"{radar.num_virtual} antennas, expected 2 chirps or more and azimuths"
        )
    spec = (points or POINTS).fitted(radar)
    limit = radar.max_velocity_mps * (2 * spec.folds + 1)

    def detected(recording: Recording, frame: int) -> Measured:
        samples = recording.cube(frame)
        return radar_points(samples, recording.radar, points=spec), limit

    return detected


def outliers(velocities: Velocities) -> Bool[np.ndarray, " frame"]:
    """Return which frames have a velocity that no motion explains; host.

    Along the ground it is much farther from the median of the frames within
    `NEIGHBOURS_S` than most of these are. A steady acceleration does not move that
    median.
    """
    stamps, ground = velocities.stamps, velocities.velocity[:, :2]
    known = np.isfinite(velocities.velocity).all(1)
    found = np.zeros(len(stamps), bool)
    for frame in np.flatnonzero(known):
        near = known & (abs(stamps - stamps[frame]) <= NEIGHBOURS_S)
        if near.sum() < LEAST_NEIGHBOURS:
            continue
        apart = np.linalg.norm(ground[near] - np.median(ground[near], axis=0), axis=1)
        usual = OUTLIER_DEVIATIONS * TO_DEVIATION * np.median(apart)
        here = apart[np.count_nonzero(near[:frame])]
        found[frame] = here > max(OUTLIER_MPS, usual)
    return found


def _velocities(stamps, rows):
    """Rows of velocity, covariance and counts as columns."""
    columns = [np.array(jax.device_get(column)) for column in zip(*rows, strict=True)]
    velocity, covariance = (column.astype(float) for column in columns[:2])
    return Velocities(stamps, velocity, covariance, *columns[2:])
