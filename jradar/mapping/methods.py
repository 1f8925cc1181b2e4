"""How a network of maps answers: what it learns, and the score of a voxel from 0 to 1.

occupancy   one pass: the probability of each voxel
nearness    one pass: the expected nearness, 1 in an occupied voxel, 2/3 and 1/3 in the
            voxels around it; neighbours of a likely voxel score too
diffusion   the paper's method in the plane of the map: columns drawn from noise; the
            score is the mean of several draws
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jradar.diffusion import (
    PREDICTIONS,
    Denoiser,
    NoiseSpec,
    denoising_loss,
    sample,
)

SHARE = 0.03  # of occupied voxels; the network's output is relative to its log-odds
REACH = 3  # voxels at which nearness is 0
QUICK_STEPS = 5  # of each of several draws

Columns = Float[Array, "batch x y height"]


@dataclasses.dataclass(frozen=True)
class MapMethod:
    """A method by its name: noise levels, loss as in `jradar.diffusion`, and scores.

    `scores(key, denoise, shape, noise, draws=)` returns those of each voxel.
    """

    name: str
    noise: NoiseSpec
    loss: Callable[..., Float[Array, ""]]
    scores: Callable[..., Columns]


def log_odds(denoise: Denoiser, shape: tuple[int, ...], noise: NoiseSpec) -> Columns:
    """Return the log-odds of each voxel."""
    given: Any = jax.ShapeDtypeStruct(shape, jnp.float32)
    odds = denoise(given, jnp.asarray(noise.sigma_max))
    return odds + jnp.log(SHARE / (1 - SHARE))


def occupancy_loss(
    key: Any, denoise: Denoiser, clean: Any, *, noise: NoiseSpec, step: Any = 0
) -> Float[Array, ""]:
    """Return the mean cross-entropy of columns; `key` and `step` are not used."""
    odds = log_odds(denoise, clean.shape, noise)
    return cross_entropy(odds, clean).sum(-1).mean()


def nearness_loss(
    key: Any, denoise: Denoiser, clean: Any, *, noise: NoiseSpec, step: Any = 0
) -> Float[Array, ""]:
    """Return `occupancy_loss` for the nearness of voxels instead of their occupancy."""
    odds = log_odds(denoise, clean.shape, noise)
    return cross_entropy(odds, nearness(clean)).sum(-1).mean()


def columns_loss(
    key: Any, denoise: Denoiser, clean: Any, *, noise: NoiseSpec, step: Any = 0
) -> Float[Array, ""]:
    """Return EDM's loss for columns of about mean 0; `step` is not used."""
    return denoising_loss(key, denoise, 2 * (clean - SHARE), noise=noise)


def nearness(occupied: Columns) -> Columns:
    """Return 1 - distance / REACH, at least 0, of each voxel to an occupied one.

    The distance is the largest of those along the axes, in voxels.
    """
    total, grown = occupied, occupied
    for _ in range(REACH - 1):
        grown = jax.lax.reduce_window(
            grown, 0.0, jax.lax.max, (1, 3, 3, 3), (1, 1, 1, 1), "SAME"
        )
        total = total + grown
    return total / REACH


def cross_entropy(odds: Any, share: Any) -> Any:
    """Return that of probabilities given as log-odds."""
    return jax.nn.softplus(odds) - share * odds


def _one_pass(key, denoise, shape, noise, *, draws):
    """The probabilities of one pass; neither `key` nor `draws` is used."""
    return jax.nn.sigmoid(log_odds(denoise, shape, noise))


def _drawn(key, denoise, shape, noise, *, draws):
    """The mean of draws, one after another; several are quick ones."""
    steps = 18 if draws == 1 else QUICK_STEPS

    def draw(key):
        image = sample(key, denoise, shape, noise=noise, steps=steps)
        return jnp.clip(image / 2 + SHARE, 0, 1)

    return jax.lax.map(draw, jax.random.split(key, draws)).mean(0)


_ONE = NoiseSpec(sigma_data=1.0, prediction=PREDICTIONS["mixture"])
_EDM = NoiseSpec(sigma_data=0.35, log_mean=0.5, log_std=1.5)
METHODS = {
    method.name: method
    for method in (
        MapMethod("occupancy", _ONE, occupancy_loss, _one_pass),
        MapMethod("nearness", _ONE, nearness_loss, _one_pass),
        MapMethod("diffusion", _EDM, columns_loss, _drawn),
    )
}
