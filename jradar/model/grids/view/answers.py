"""How a network of range images answers: from a denoiser to ranges with confidence.

diffusion     several samples, and the range on which they agree
marginal      each pixel's distribution, from one evaluation
regression    one estimate, without confidence
"""

from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp

from jradar.diffusion import (
    SOLVERS,
    RangeMixture,
    range_mixture,
    regression_estimate,
    sample,
    window_mass,
)
from jradar.model.grids.base import Answer, Question, no_draws
from jradar.range_image import (
    ImageSpec,
    RangeImage,
    agreed_range,
    decode_range,
    decode_target,
    encode_range,
)

TRIED = 6  # components of a mixture; the heaviest of its anchors come first
SIDE_STEPS = (-0.5, 0.5)  # of a window, tried to both sides of the best component


@runtime_checkable
class Coding(Protocol):
    """How ranges stand in the network's images; `ViewGrid` is one."""

    @property
    def fine(self) -> ImageSpec:
        """The pixels of an image."""
        ...

    @property
    def codec(self) -> str:
        """How a range becomes a value: a key of `CODECS`."""
        ...

    @property
    def validity_threshold(self) -> float:
        """The value of validity above which a pixel has a range."""
        ...


def draw_diffusion(
    asked: Question, grid: Coding, *, draws: int = 8, **sampling: Any
) -> RangeImage:
    """Return one sample, or what several agree on."""
    if draws < 1:
        raise ValueError(f"{draws=}, expected 1 or more")
    quick = {"solver": SOLVERS["ipndm3"], "steps": 5, "temperature": 1.0}
    careful = {"steps": 18, "temperature": asked.temperature}
    values = sample(
        asked.key,
        asked.denoise(asked.condition[None]),
        (draws, *grid.fine.shape, 2),
        noise=asked.noise,
        **{**(careful if draws == 1 else quick), **sampling},
    )
    images = _metres(values, grid)
    return RangeImage(images[0]) if draws == 1 else agreed_range(images)


def draw_marginal(asked: Question, grid: Coding, **sampling: Any) -> RangeImage:
    """Return the likeliest range of each pixel."""
    no_draws(sampling, "a model of one pass draws no samples")
    shape = (1, *grid.fine.shape, 2)
    denoise = asked.denoise(asked.condition[None])
    mixture = range_mixture(denoise, shape, noise=asked.noise)
    return likeliest_range(RangeMixture(*(value[0] for value in mixture)), grid)


def draw_regression(asked: Question, grid: Coding, **sampling: Any) -> RangeImage:
    """Return the network's one estimate."""
    no_draws(sampling, "a model trained by regression draws no samples")
    shape = (1, *grid.fine.shape, 2)
    denoise = asked.denoise(asked.condition[None])
    values = regression_estimate(denoise, shape, noise=asked.noise)
    return RangeImage(_metres(values, grid)[0])


METHODS: dict[str, Answer] = {
    "diffusion": draw_diffusion,
    "marginal": draw_marginal,
    "regression": draw_regression,
}


def likeliest_range(mixture: RangeMixture, grid: Coding) -> RangeImage:
    """Return the range whose window holds the most probability.

    The window reaches as far to either side as is near in the grid's view. The
    confidence is that probability times the probability of a return. The windows around
    the first TRIED components' centres are tried, and two next to the best.
    """
    view = {"max_range_m": grid.fine.max_range_m, "codec": grid.codec}
    window_m = grid.fine.near_m
    inside = window_mass(mixture)

    def mass(range_m):
        low, high = (
            encode_range(range_m + side, **view) for side in (-window_m, window_m)
        )
        return inside(low, high)

    # `map` computes each mass once; XLA would fuse and compute it for both results.
    centres = decode_range(jnp.moveaxis(mixture.centre[..., :TRIED], -1, 0), **view)
    best, most = _best(centres, jax.lax.map(mass, centres))
    beside = jnp.stack([best + step * window_m for step in SIDE_STEPS])
    masses = jax.lax.map(mass, beside)
    best, most = _best([best, *beside], [most, *masses])
    returned = 1 / (1 + jnp.exp(-mixture.returned))
    return RangeImage(jnp.maximum(best, 0.0), returned * most)


def _best(ranges, masses):
    """Return the range of the most mass, the first of equals, and its mass."""
    best, most = ranges[0], masses[0]
    for other, found in zip(ranges[1:], masses[1:], strict=True):
        best = jnp.where(found > most, other, best)
        most = jnp.maximum(found, most)
    return best, most


def _metres(values, grid: Coding):
    """Return range images in metres from the network's values."""
    return decode_target(
        values, grid.fine, codec=grid.codec, validity_threshold=grid.validity_threshold
    )
