"""One pass: each pixel's distribution over range, from one evaluation of the network.

The network sees only the condition, as in `regression`. For each pixel it returns the
probability of a return, and a mixture of logistic distributions over the coded range.
The mixture is trained by its likelihood, so that a pixel that may lie on either of two
surfaces has two components, not a mean between them (mixture density networks, Bishop
1994; Tosi et al. 2021 for depth).

    F [.. 2 + 3 COMPONENTS] -> centre, return | offset, log-scale, weight of components

Further channels are components of their own: logit, centre and scale of each anchor
(`evidence`).
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Key

from jradar.diffusion.losses import known_share
from jradar.diffusion.noise import NoiseSpec
from jradar.diffusion.precondition import Denoiser
from jradar.diffusion.predictions import FREE, Image

# Scales of the components where the network returns 0; they differ, so that the
# components learn different things.
FIRST_SCALES = (0.01, 0.02, 0.05, 0.2)
LEAST_SCALE = 1e-3
THINNED = 2  # rows and columns of pixels, of which one counts in the loss
SHARPNESS = 4.0  # logit of a return for each unit of validity, which is -1 to 1


class RangeMixture(NamedTuple):
    """Distributions over the coded range (-1 .. 1) of each pixel."""

    returned: Float[Array, "*batch row column"]  # logit of a return
    weight: Float[Array, "*batch row column component"]  # sum 1
    centre: Float[Array, "*batch row column component"]
    scale: Float[Array, "*batch row column component"]


def range_mixture(
    denoise: Denoiser, shape: tuple[int, ...], *, noise: NoiseSpec
) -> RangeMixture:
    """Return the mixtures of images of `shape` [*batch row column 2]."""
    return mixture_of(denoise(_blank(shape), jnp.asarray(noise.sigma_max)))


def mixture_of(values: Float[Array, "*batch row column output"]) -> RangeMixture:
    """Return the mixtures that the outputs of the prediction "mixture" describe."""
    # Outputs come first meanwhile: XLA's loops are fast along pixels, not components.
    fields = jnp.moveaxis(values, -1, 0)
    offset, growth, weight = jnp.split(fields[2:FREE], 3)
    logit, centre, scale = jnp.split(fields[FREE:], 3)
    first = np.log(FIRST_SCALES).astype(values.dtype)
    first = first.reshape(-1, *[1] * (values.ndim - 1))
    components = (
        _softmax(jnp.concatenate([SHARPNESS * weight, logit])),
        jnp.concatenate([fields[:1] + offset, centre]),
        jnp.concatenate([jnp.exp(first + 4 * jnp.tanh(growth)), scale]) + LEAST_SCALE,
    )
    return RangeMixture(
        SHARPNESS * fields[1], *(jnp.moveaxis(part, 0, -1) for part in components)
    )


def _softmax(values):
    """The softmax along the first axis, unrolled: XLA repeats a reduction's terms."""
    largest = jax.lax.stop_gradient(functools.reduce(jnp.maximum, values))
    powers = [jnp.exp(value - largest) for value in values]
    share = 1 / sum(powers[1:], powers[0])
    return jnp.stack([power * share for power in powers])


def window_mass(mixture: RangeMixture) -> Callable[[Any, Any], Float[Array, "..."]]:
    """Return `(low, high)` -> the probability of a return between these codes."""
    weight, centre, scale = (jnp.moveaxis(part, -1, 0) for part in mixture[1:])
    steepness = 1 / scale

    def mass(low, high):
        total: Any = 0.0
        for part, middle, steep in zip(weight, centre, steepness, strict=True):
            above = jax.nn.sigmoid((high - middle) * steep)
            total += part * (above - jax.nn.sigmoid((low - middle) * steep))
        return total

    return mass


def mixture_loss(
    key: Key[Array, ""], denoise: Denoiser, clean: Image, *, noise: NoiseSpec
) -> Float[Array, ""]:
    """Return the negative log-likelihood of range and return, a mean over pixels.

    Where the validity of `clean` is 0, it is unknown whether there was a return. The
    mean is over the other pixels, and then over images.

    It is called as `denoising_loss` is. Neighbours are alike: of each THINNED x THINNED
    pixels of an image, `key` draws the one that counts, the same place in all of them.
    """
    values = denoise(_blank(clean.shape), jnp.asarray(noise.sigma_max))
    share = known_share(clean)[:, None, None]
    mixture = mixture_of(_thinned(key, values))
    clean = _thinned(key, clean)
    hit = clean[..., 1] > 0
    sign = jnp.sign(clean[..., 1])
    returned = jnp.abs(sign) * jax.nn.log_sigmoid(sign * mixture.returned)
    away = (clean[..., :1] - mixture.centre) / mixture.scale
    density = (  # of the logistic distribution, in logarithms
        jax.nn.log_sigmoid(away) + jax.nn.log_sigmoid(-away) - jnp.log(mixture.scale)
    )
    weight = jnp.log(jnp.maximum(mixture.weight, 1e-6))
    range_ = jax.nn.logsumexp(weight + density, axis=-1)
    return -jnp.mean((returned + jnp.where(hit, range_, 0.0)) / share)


def _blank(shape) -> Any:
    """An image of zeros, by its shape."""
    return jax.ShapeDtypeStruct(shape, jnp.zeros(()).dtype)


def _thinned(key, image):
    """One of each THINNED x THINNED pixels; an image of odd size stays whole."""
    *leading, rows, columns, channels = image.shape
    if rows % THINNED or columns % THINNED:
        return image
    row, column = jax.random.randint(key, (2,), 0, THINNED)
    shape = (*leading, rows // THINNED, THINNED, columns // THINNED, THINNED, channels)
    chosen = jax.lax.dynamic_index_in_dim(image.reshape(shape), row, -4, False)
    return jax.lax.dynamic_index_in_dim(chosen, column, -2, False)
