"""How a network of maps answers: the score of a voxel from 0 to 1.

occupancy   one pass: the probability of each voxel
nearness    one pass: the expected nearness, 1 in an occupied voxel, 2/3 and 1/3 in the
            voxels around it; neighbours of a likely voxel score too
diffusion   the paper's method in the plane of the map: columns drawn from noise; the
            score is the mean of several draws
"""

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jradar.diffusion import PREDICTIONS, NoiseSpec, sample
from jradar.diffusion.occupancy_losses import SHARE, log_odds

QUICK_STEPS = 5  # of each of several draws

Columns = Float[Array, "batch x y height"]


@dataclasses.dataclass(frozen=True)
class MapMethod:
    """A method by its name: noise levels and scores.

    `scores(key, denoise, shape, noise, draws=)` returns those of each voxel.
    """

    name: str
    noise: NoiseSpec
    scores: Callable[..., Columns]


def _one_pass(key, denoise, shape, noise, *, draws):
    """The probabilities of one pass; neither `key` nor `draws` is used."""
    return jax.nn.sigmoid(log_odds(denoise, shape, noise=noise))


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
        MapMethod("occupancy", _ONE, _one_pass),
        MapMethod("nearness", _ONE, _one_pass),
        MapMethod("diffusion", _EDM, _drawn),
    )
}
