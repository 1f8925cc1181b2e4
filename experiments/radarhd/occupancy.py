"""Occupancy images: a prediction and the losses of pixels that are 0 or 1.

The network predicts log-odds F of a pixel from its surroundings and the condition, and
Bayes' rule adds the evidence of the pixel's own noisy value x:

    D(x; sigma) = sigmoid(F + ln(p / (1 - p)) + (x - 1/2) / sigma^2)

where p is the share of occupied pixels, from sigma_data^2 = p (1 - p).
"""

import functools
import math
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Key

from jradar.diffusion import (
    Denoiser,
    NoiseSpec,
    Prediction,
    regression_estimate,
    scalings,
    training_sigma,
)

Image = Float[Array, "batch row column channel"]


class Occupancy(Prediction):
    """The prediction of pixels that are 0 or 1; see the module's docstring."""

    def check(self, noise: NoiseSpec) -> None:
        """Raise ValueError for a spread that no image of 0 and 1 has."""
        if noise.sigma_data > 0.5:
            raise ValueError(
                f"sigma_data = {noise.sigma_data}, expected at most 0.5, the largest "
                "standard deviation of pixels that are 0 or 1"
            )

    def denoise(self, network: Any, x: Any, sigma: Any, noise: NoiseSpec) -> Any:
        """Return D(x; sigma), the probability of each pixel."""
        _, _, c_in, c_noise = scalings(sigma, noise)
        odds = network(c_in[..., None, None, None] * x, c_noise)
        evidence = (x - 0.5) / sigma[..., None, None, None] ** 2
        return jax.nn.sigmoid(odds + prior(noise) + evidence)


OCCUPANCY = Occupancy("occupancy")


def prior(noise: NoiseSpec) -> float:
    """Return the log-odds of the share of occupied pixels."""
    share = (1 - math.sqrt(1 - 4 * noise.sigma_data**2)) / 2
    return math.log(share / (1 - share))


def occupancy_denoising_loss(
    key: Key[Array, ""],
    denoise: Denoiser,
    clean: Image,
    *,
    noise: NoiseSpec,
    step: int | Int[Array, ""] = 0,
) -> Float[Array, ""]:
    """Return the cross-entropy at random noise levels, relative to the prior's.

    The denoiser of least cross-entropy is also that of least squared error, but the
    gradient of the cross-entropy does not vanish where the denoiser is sure and wrong.
    `step` is not used.
    """
    sigma_key, noise_key = jax.random.split(key)
    sigma = training_sigma(sigma_key, clean.shape[:1], noise)
    unit = jax.random.normal(noise_key, clean.shape, clean.dtype)
    share = denoise(clean + sigma[:, None, None, None] * unit, sigma)
    return cross_entropy(share, clean, noise)


def occupancy_regression_loss(
    key: Key[Array, ""],
    denoise: Denoiser,
    clean: Image,
    *,
    noise: NoiseSpec,
    step: int | Int[Array, ""] = 0,
) -> Float[Array, ""]:
    """Return squared error plus Dice of the one-pass estimate (Prabhakara et al. 2023).

    Dice is computed for each image. `key` and `step` are not used.
    """
    share = regression_estimate(denoise, clean.shape, noise=noise)
    both = (share * clean).sum((1, 2, 3))
    either = (share + clean).sum((1, 2, 3))
    dice = 1 - 2 * both / jnp.maximum(either, 1e-6)
    return jnp.mean((share - clean) ** 2) + dice.mean()


@functools.partial(jax.jit, static_argnames="reach")
def agreed_occupancy(
    images: Float[Array, "draw *batch row column"], *, reach: int = 1
) -> Float[Array, "*batch row column"]:
    """Return the share of draws that have an occupied pixel near each pixel.

    Near is within `reach` rows and columns. Pixels that no draw has are 0. This is the
    counterpart of `agreed_range` for images with any number of surfaces in a column; as
    there, the share is the confidence.
    """
    if reach < 0:
        raise ValueError(f"{reach=}, expected 0 or more pixels")
    occupied = (images > 0.5).astype(images.dtype)
    size = 2 * reach + 1
    window = (1,) * (images.ndim - 2) + (size, size)
    near = jax.lax.reduce_window(
        occupied, 0.0, jax.lax.max, window, (1,) * images.ndim, "SAME"
    )
    return jnp.where(occupied.any(0), near.mean(0), 0.0)


def cross_entropy(share: Image, clean: Image, noise: NoiseSpec) -> Float[Array, ""]:
    """Return the mean cross-entropy of pixels, relative to that of the prior."""
    share = jnp.clip(share, 1e-6, 1 - 1e-6)
    loss = -clean * jnp.log(share) - (1 - clean) * jnp.log1p(-share)
    start = jax.nn.sigmoid(prior(noise))
    entropy = -start * jnp.log(start) - (1 - start) * jnp.log1p(-start)
    return loss.mean() / entropy
