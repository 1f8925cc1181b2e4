"""Frames to training pairs, held in memory and drawn as a pure function of the step."""

import functools
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float, Key

from jradar.data.scenes import room_frame
from jradar.radar import RadarSpec, radar_points
from jradar.range_image import ImageSpec, condition_image
from jradar.types import PointCloud


class Pairs(NamedTuple):
    """Conditions and what should come out, one entry per frame."""

    condition: Float[Array, "frame row column channel"]
    lidar: Float[Array, "frame lidar_row lidar_column"]  # metres, 0 for a miss
    radar: PointCloud  # the baseline's detections, for comparison


def make_pairs(
    key: Key[Array, ""],
    num_frames: int,
    *,
    radar: RadarSpec,
    coarse: ImageSpec,
    fine: ImageSpec,
    num_slices: int,
    points: dict[str, Any],
    baseline: dict[str, Any],
) -> Pairs:
    """Pairs of `num_frames` simulated rooms; frame i depends on `key` and i only.

    `points` are the options of `radar_points` for the condition, `baseline` those for
    the detector that results are compared with.
    """

    @jax.jit
    def pair(key):
        frame = room_frame(key, radar, fine)
        cloud = radar_points(frame.cube, radar, **points)
        condition = condition_image(cloud, coarse, num_slices=num_slices)
        return Pairs(
            condition, frame.lidar, radar_points(frame.cube, radar, **baseline)
        )

    keys = jax.vmap(functools.partial(jax.random.fold_in, key))(np.arange(num_frames))
    return jax.tree.map(lambda *x: np.stack(x), *(pair(key) for key in keys))


def batch_indices(seed: int, step: int, *, batch_size: int, num_frames: int):
    """Frames of the batch at a training step, `[batch]`, on the host.

    Every epoch is a permutation of its own; a remainder smaller than a batch is left
    out of it. Raises ValueError where there are fewer frames than a batch holds.
    """
    batches = num_frames // batch_size
    if not batches:
        raise ValueError(
            f"{batch_size=} is more than the {num_frames} frames there are"
        )
    epoch, batch = divmod(step, batches)
    order = np.random.default_rng([seed, epoch]).permutation(num_frames)
    return order[batch * batch_size : (batch + 1) * batch_size]
