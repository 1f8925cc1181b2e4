"""The losses of models of maps."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jradar.diffusion import Denoiser, NoiseSpec

OUTSIDE = 0.25  # weight of columns outside the LiDAR's patch
SHARE = 0.03  # of occupied voxels; the network's output is relative to its log-odds


def log_odds(
    denoise: Denoiser, shape: tuple[int, ...], noise: NoiseSpec
) -> Float[Array, "batch x y channel"]:
    """Return the log-odds of each voxel, and of each column to be inside the patch."""
    given: Any = jax.ShapeDtypeStruct(shape, jnp.float32)
    odds = denoise(given, jnp.asarray(noise.sigma_max))
    return odds.at[..., :-1].add(jnp.log(SHARE / (1 - SHARE)))


def occupancy_loss(
    key: Any, denoise: Denoiser, clean: Any, *, noise: NoiseSpec, step: Any = 0
) -> Float[Array, ""]:
    """Return the cross-entropy of a column's voxels and of its place in the patch.

    `key` and `step` are not used.
    """
    odds = log_odds(denoise, clean.shape, noise)
    occupied, inside = clean[..., :-1], clean[..., -1]
    entropy = cross_entropy(odds[..., :-1], occupied).sum(-1)
    weight = OUTSIDE + (1 - OUTSIDE) * inside
    columns = (weight * entropy).mean()
    place = cross_entropy(odds[..., -1], inside)
    return columns + (place * occupied.any(-1)).mean()


def cross_entropy(odds: Any, share: Any) -> Any:
    """Return that of probabilities given as log-odds."""
    return jax.nn.softplus(odds) - share * odds
