"""How a network of maps answers: what it learns, and the score of a voxel from 0 to 1.

occupancy   one pass: the probability of each voxel
nearness    one pass: the expected nearness, 1 in an occupied voxel, 2/3 and 1/3 in the
            voxels around it; neighbours of a likely voxel score too
diffusion   the paper's method in the plane of the map: columns drawn from noise; the
            score is the mean of several draws
"""

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
from jradar.model.grids.base import Answer, Question, no_draws

SHARE = 0.03  # of occupied voxels; the network's output is relative to its log-odds
REACH = 3  # voxels at which nearness is 0
QUICK_STEPS = 5  # of each of several draws

Columns = Float[Array, "batch x y height"]


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


def one_pass(asked: Question, grid: Any, **sampling: Any) -> Columns:
    """Return the probabilities of one pass."""
    no_draws(sampling, "a model of one pass draws no samples")
    shape = (1, *asked.condition.shape[:-1], grid.heights)
    odds = log_odds(asked.denoise(asked.condition[None]), shape, asked.noise)
    return jax.nn.sigmoid(odds)[0]


def draw_columns(
    asked: Question, grid: Any, *, draws: int = 8, steps: int | None = None, **how: Any
) -> Columns:
    """Return the mean of draws, one after another; several are quick ones."""
    shape = (1, *asked.condition.shape[:-1], grid.heights)
    denoise = asked.denoise(asked.condition[None])
    how = {"steps": steps or (18 if draws == 1 else QUICK_STEPS), **how}

    def draw(key):
        image = sample(key, denoise, shape, noise=asked.noise, **how)
        return jnp.clip(image / 2 + SHARE, 0, 1)

    return jax.lax.map(draw, jax.random.split(asked.key, draws)).mean(0)[0]


METHODS: dict[str, Answer] = {
    "occupancy": one_pass,
    "nearness": one_pass,
    "diffusion": draw_columns,
}
ONE_PASS = NoiseSpec(sigma_data=1.0, prediction=PREDICTIONS["mixture"])
NOISE = {  # levels of each method's training
    "occupancy": ONE_PASS,
    "nearness": ONE_PASS,
    "diffusion": NoiseSpec(sigma_data=0.35, log_mean=0.5, log_std=1.5),
}
LOSSES = {
    "occupancy": occupancy_loss,
    "nearness": nearness_loss,
    "diffusion": columns_loss,
}
