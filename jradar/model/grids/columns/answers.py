"""How a network of maps answers: with the probability of each voxel.

occupancy   one pass: the probability of each voxel
nearness    one pass: the expected nearness, 1 in an occupied voxel, 2/3 and 1/3 in the
            voxels around it; neighbours of a likely voxel score too
diffusion   the paper's method in the plane of the map: columns drawn from noise, and
            the mean of several draws
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jradar.diffusion import PREDICTIONS, SHARE, NoiseSpec, log_odds, sample
from jradar.model.grids.base import Answer, Question, no_draws

QUICK_STEPS = 5  # of each of several draws

Columns = Float[Array, "x y height"]


def one_pass(asked: Question, grid: Any, **sampling: Any) -> Columns:
    """Return the probabilities of one pass."""
    no_draws(sampling, "a model of one pass draws no samples")
    denoise, shape = asked.denoise(asked.condition[None]), _shape(asked, grid)
    return jax.nn.sigmoid(log_odds(denoise, shape, noise=asked.noise))[0]


def draw_columns(
    asked: Question, grid: Any, *, draws: int = 8, steps: int | None = None, **how: Any
) -> Columns:
    """Return the mean of draws, made one after another; several take few steps each."""
    denoise, shape = asked.denoise(asked.condition[None]), _shape(asked, grid)
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


def _shape(asked: Question, grid: Any) -> tuple[int, int, int, int]:
    """Return the shape of the answer to a condition, which may have any size."""
    x, y, _ = asked.condition.shape
    return 1, x, y, grid.heights
