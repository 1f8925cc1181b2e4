"""A radar map to the probability of each voxel, and to occupied voxels."""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from jradar.diffusion import Network, NoiseSpec, conditional_denoiser
from jradar.mapping.columns import (
    MapSpec,
    Voxels,
    condition_columns,
    middle_height,
    outline,
)
from jradar.mapping.losses import log_odds

SIZES = (64, 96, 128, 160)  # of images; few, since each is a compiled program
MARGIN = 16  # columns of an image beyond the radar's patch, both sides together


class VoxelMap(NamedTuple):
    """Voxels by their numbers, and the probability that each is occupied."""

    voxels: Int[np.ndarray, "voxel 3"]
    probability: Float[np.ndarray, " voxel"]


@functools.partial(jax.jit, static_argnames=("network", "noise"))
def map_log_odds(
    condition: Float[jax.Array, "batch x y channel"],
    *,
    params: Any,
    network: Network,
    noise: NoiseSpec,
) -> Float[jax.Array, "batch x y channel"]:
    """Return the log-odds of voxels, and of columns to be in the LiDAR's patch."""
    denoise = conditional_denoiser(network, params, noise)(condition)
    shape = (*condition.shape[:-1], condition.shape[-1] - 2)
    return log_odds(denoise, shape, noise)


def patch_condition(
    radar: Voxels, spec: MapSpec
) -> tuple[np.ndarray, tuple[int, int, int]]:
    """Return the image around a patch of a radar map, and its first voxel."""
    around = outline(radar)
    wanted = 2 * around.radius + MARGIN
    size = next((size for size in SIZES if size >= wanted), SIZES[-1])
    x, y = round(around.x) - size // 2, round(around.y) - size // 2
    origin = (x, y, middle_height(radar) - spec.heights // 2)
    image = condition_columns(radar, origin, (size, size), spec, observed=around)
    return image, origin


def enhance_patch(radar: Voxels, spec: MapSpec, **model: Any) -> VoxelMap:
    """Return the voxels of a LiDAR patch around a radar patch, likely ones first."""
    image, origin = patch_condition(radar, spec)
    odds = map_log_odds(jnp.asarray(image[None]), **model)[0]
    share = np.asarray(jax.nn.sigmoid(odds[..., :-1]) * jax.nn.sigmoid(odds[..., -1:]))
    cells = np.argwhere(share > 0.01)
    found = share[tuple(cells.T)]
    order = np.argsort(-found, kind="stable")
    return VoxelMap(cells[order] + np.asarray(origin), found[order])


def best_count(probability: np.ndarray, truth: int) -> int:
    """Return how many likely voxels have the largest expected F-score.

    With `truth` occupied voxels, of which the first k hold a part, the expected F-score
    is about 2 * sum(probability[:k]) / (k + truth).
    """
    hits = np.cumsum(probability)
    return int(np.argmax(2 * hits / (np.arange(len(hits)) + 1 + truth))) + 1
