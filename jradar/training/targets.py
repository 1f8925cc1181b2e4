"""What networks learn to draw: range images of the LiDAR, and nearness to its points.

    nearness of a pixel = max(0, 1 - distance to the nearest occupied pixel / reach)

Where a wall may lie a little nearer or farther, no single pixel is likely to be
occupied, but many are likely to be near it: those of a large expected nearness make a
cloud of small distances.
"""

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jradar import data
from jradar.compiled import jit
from jradar.data import Batch
from jradar.model import ViewGrid
from jradar.model.grids.polar import LIDAR, MAX_RANGE_M
from jradar.range_image import close_gaps, encode_target, observed_pixels

GAP_PIXELS = 2  # between the LiDAR's beams, closed in targets
REACH_M = 0.3  # distance at which the nearness of polar images is 0
RANGE_STEP_M = MAX_RANGE_M / (len(LIDAR.ranges) - 1)
REACH = int(REACH_M / RANGE_STEP_M)  # rows
REACH_VOXELS = 3
FAR = 1e6  # a squared distance, or a number of columns, beyond all others


def pair_batches(
    frames: Sequence,
    grid: ViewGrid,
    change: data.AugmentSpec,
    *,
    batch_size: int,
    seed: int,
    gap_pixels: int = GAP_PIXELS,
    reach: int = 0,
) -> Callable[[int], Batch]:
    """Return the function from a step to a batch of frames, changed at random.

    `frames` are prepared ones, or `data.histories`.

    Gaps of `gap_pixels` between the LiDAR's beams are closed. If beams are farther
    apart, `reach` pixels, empty pixels that close to a hit are not learnt.
    """
    pairs = data.AugmentedPairs(
        grid.coarse, grid.fine, grid.num_slices, change, grid.channels
    )
    batches = data.Batches(frames, seed=seed, batch_size=batch_size, change=pairs)

    def batch_at(step: int) -> Batch:
        batch = batches[step]
        closed = close_gaps(batch.lidar, reach=gap_pixels)
        target = encode_target(closed, grid.fine, codec=grid.codec)
        if reach > gap_pixels:
            observed = observed_pixels(closed, reach=reach)[..., None]
            target = target.at[..., 1:].multiply(observed)
        return Batch(batch.condition, target)

    return batch_at


@jit
def polar_nearness(
    occupied: Float[Array, "*batch range azimuth 1"],
) -> Float[Array, "*batch range azimuth 1"]:
    """Return the nearness of each pixel of occupancy images on RadarHD's grid.

    Distances are exact, in the plane, between the middles of pixels. Raises ValueError
    for images of another size.
    """
    rows, columns = occupied.shape[-3:-1]
    if (rows, columns) != LIDAR.shape:
        raise ValueError(
            f"image has {rows} x {columns} pixels, expected {LIDAR.shape}, whose "
            "ranges and angles are known"
        )
    here, axis = occupied[..., 0] > 0.5, occupied.ndim - 2
    column = jnp.arange(columns, dtype=jnp.float32)
    last = jax.lax.cummax(jnp.where(here, column, -FAR), axis)
    following = jax.lax.cummin(jnp.where(here, column, FAR), axis, reverse=True)
    apart = jnp.minimum(column - last, following - column)  # along the row
    # The squared chord of that angle on a circle of radius 1.
    chord = 4 * jnp.sin(LIDAR.azimuth_step / 2 * jnp.minimum(apart, columns)) ** 2
    chord = jnp.where(apart < columns, chord, FAR)
    around = [(0, 0)] * (axis - 1) + [(REACH, REACH), (0, 0)]
    chord = jnp.pad(chord, around, constant_values=FAR)
    range_m = RANGE_STEP_M * jnp.arange(rows)[:, None]
    nearest = jnp.full(here.shape, FAR)
    for offset in range(-REACH, REACH + 1):
        first, other_m = REACH + offset, range_m + offset * RANGE_STEP_M
        there = jax.lax.slice_in_dim(chord, first, first + rows, axis=axis - 1)
        across = jnp.where(there < FAR, range_m * other_m * there, FAR)
        nearest = jnp.minimum(nearest, (offset * RANGE_STEP_M) ** 2 + across)
    return jnp.maximum(1 - jnp.sqrt(nearest) / REACH_M, 0)[..., None]


def voxel_nearness(
    occupied: Float[Array, "batch x y height"],
) -> Float[Array, "batch x y height"]:
    """Return the nearness of each voxel to the occupied ones.

    The distance is the largest of those along the axes, in voxels.
    """
    total, grown = occupied, occupied
    for _ in range(REACH_VOXELS - 1):
        grown = jax.lax.reduce_window(
            grown, 0.0, jax.lax.max, (1, 3, 3, 3), (1, 1, 1, 1), "SAME"
        )
        total = total + grown
    return total / REACH_VOXELS
