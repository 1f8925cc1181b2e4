"""The radar's own velocity in each frame of a recording."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from jradar.errors import UsageError
from jradar.motion.doppler import ego_velocity
from jradar.radar import PointSpec, radar_points
from jradar.recordings import RadarClouds, Recording
from jradar.types import PointCloud

POINTS = PointSpec(capacity=512)


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
    seed: int = 0,
    advance: Callable[[int], None] = lambda done: None,
) -> Velocities:
    """Return the radar's velocity in each of `frames`, by default in all; host.

    With `points.folds`, velocities beyond the unambiguous one are found, too. `advance`
    is called with the number of frames done. Raises UsageError if the frames have no
    times or the radar has no Doppler.
    """
    radar, stamps = recording.radar.spec, recording.cubes.stamps
    chosen = range(len(recording.cubes)) if frames is None else frames
    if stamps is None or not len(chosen):
        raise UsageError(
            f"{recording.path}: {len(chosen)} frames, expected some with known times: "
            "set frame_period_s, or name the frames' stamps"
        )
    if radar.num_chirps < 2 or not radar.has_azimuth:
        raise UsageError(
            f"{radar.name} sends {radar.num_chirps} chirps a frame to an array of "
            f"{radar.num_virtual} antennas, expected 2 chirps or more and azimuths"
        )
    spec = (points or POINTS).fitted(radar)
    key, rows = jax.random.key(seed), []
    for done, frame in enumerate(chosen, 1):
        cloud = radar_points(recording.cube(frame), recording.radar, points=spec)
        found = ego_velocity(
            jax.random.fold_in(key, frame),
            cloud,
            elevation=radar.has_elevation,
            unambiguous_mps=radar.max_velocity_mps * (2 * spec.folds + 1),
            folds=0,
        )
        counts = (mask.sum() for mask in (cloud.valid, found.inliers, found.moving))
        rows.append((found.velocity, found.covariance, *counts))
        advance(done)
    middle = stamps[list(chosen)] + radar.frame_middle_s
    return _velocities(middle, rows)


def cloud_velocities(
    bag: RadarClouds,
    *,
    frames: slice = slice(None),
    seed: int = 0,
    advance: Callable[[int], None] = lambda done: None,
) -> Velocities:
    """Return the radar's velocity in each cloud of a bag; host.

    The clouds' velocities are taken as unambiguous. `frames` and `advance` as in
    `frame_velocities`. Raises UsageError for fewer than two clouds.
    """
    clouds, stamps = bag.clouds[frames], bag.stamps[frames]
    if len(clouds) < 2:
        raise UsageError(f"{bag.path}: {len(clouds)} clouds, expected 2 or more")
    size, rows = max(map(len, clouds)), []
    for done, cloud in enumerate(clouds, 1):
        table = np.zeros((size, 4), np.float32)  # of one size, and compiled once
        table[: len(cloud)] = cloud
        points = PointCloud(table[:, :3], np.arange(size) < len(cloud), table[:, 3])  # pyright: ignore[reportArgumentType]
        key = jax.random.fold_in(jax.random.key(seed), done)
        found = ego_velocity(key, points, elevation=bag.has_elevation)
        counts = (mask.sum() for mask in (points.valid, found.inliers, found.moving))
        rows.append((found.velocity, found.covariance, *counts))
        advance(done)
    return _velocities(stamps, rows)


def _velocities(stamps, rows):
    """Rows of velocity, covariance and counts as columns."""
    columns = [np.array(jax.device_get(column)) for column in zip(*rows, strict=True)]
    velocity, covariance = (column.astype(float) for column in columns[:2])
    return Velocities(stamps, velocity, covariance, *columns[2:])
