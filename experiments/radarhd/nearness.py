"""Nearness: how near the closest LiDAR point is to each pixel, in one pass.

    nearness of a pixel = max(0, 1 - distance to the nearest occupied pixel / REACH_M)

The network predicts its expectation from the radar image alone. Where a wall may lie a
little nearer or farther, no single pixel is likely to be occupied, but many are likely
to be near it: pixels of a large expected nearness make a cloud of small distances.
Distances are exact, in the plane, between the middles of polar pixels.
"""

import math
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Key

from experiments.radarhd.occupancy import Image, cross_entropy
from experiments.radarhd.pairs import LIDAR
from jradar.diffusion import Denoiser, NoiseSpec, regression_estimate

REACH_M = 0.3
RANGE_STEP_M = LIDAR.max_range_m / (LIDAR.num_range - 1)
AZIMUTH_STEP = math.pi / (LIDAR.num_azimuth - 1)
REACH = int(REACH_M / RANGE_STEP_M)  # rows
FAR = 1e6  # a squared distance, or a number of columns, beyond all others


@jax.jit
def nearness(occupied: Image) -> Image:
    """Return the nearness of each pixel of occupancy images on RadarHD's grid.

    Raises ValueError for images of another size.
    """
    rows, columns = occupied.shape[-3:-1]
    if (rows, columns) != LIDAR.shape:
        raise ValueError(
            f"image has {rows} x {columns} pixels, expected {LIDAR.shape}, whose "
            "ranges and angles are known"
        )
    here = occupied[..., 0] > 0.5
    column = jnp.arange(columns, dtype=jnp.float32)
    last = jax.lax.cummax(jnp.where(here, column, -FAR), here.ndim - 1)
    following = jax.lax.cummin(
        jnp.where(here, column, FAR), here.ndim - 1, reverse=True
    )
    apart = jnp.minimum(column - last, following - column)  # along the row
    # The squared chord of that angle on a circle of radius 1.
    chord = 4 * jnp.sin(AZIMUTH_STEP / 2 * jnp.minimum(apart, columns)) ** 2
    chord = jnp.where(apart < columns, chord, FAR)
    around = [(0, 0)] * (here.ndim - 2) + [(REACH, REACH), (0, 0)]
    chord = jnp.pad(chord, around, constant_values=FAR)
    range_m = RANGE_STEP_M * jnp.arange(rows)[:, None]
    nearest = jnp.full(here.shape, FAR)
    for offset in range(-REACH, REACH + 1):
        other_m = range_m + offset * RANGE_STEP_M
        there = jax.lax.slice_in_dim(
            chord, REACH + offset, REACH + offset + rows, axis=here.ndim - 2
        )
        across = jnp.where(there < FAR, range_m * other_m * there, FAR)
        squared = (offset * RANGE_STEP_M) ** 2 + across
        nearest = jnp.minimum(nearest, squared)
    return jnp.maximum(1 - jnp.sqrt(nearest) / REACH_M, 0)[..., None]


def nearness_loss(
    key: Key[Array, ""],
    denoise: Denoiser,
    clean: Image,
    *,
    noise: NoiseSpec,
    step: int | Int[Array, ""] = 0,
) -> Float[Array, ""]:
    """Return the cross-entropy of the one-pass estimate to the nearness of `clean`.

    It is least where the estimate is the expectation given the condition. `key` and
    `step` are not used.
    """
    estimate = regression_estimate(denoise, clean.shape, noise=noise)
    return cross_entropy(estimate, nearness(clean), noise)


def mirrored(draw: Any, key: jax.Array, condition: Any) -> jax.Array:
    """Return the mean of the images of conditions and, mirrored back, of their mirrors.

    Left and right are alike to a radar that looks ahead, not to a trained network.
    """
    there = draw(key, condition[:, :, ::-1])[:, :, ::-1]
    return (draw(key, condition) + there) / 2
