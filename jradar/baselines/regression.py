"""Direct regression: the diffusion model's own network without the diffusion.

The network sees no image, only the condition: its estimate is D(0; sigma_max), where
the preconditioning passes the network's output through. Trained with the squared error
it approaches the mean of all images that the condition allows, and is blurred where
these differ. Losses are called as `denoising_loss` is.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Key

from jradar.diffusion import Denoiser, NoiseSpec, channel_weights

Image = Float[Array, "batch row column channel"]


def regression_estimate(
    denoise: Denoiser, shape: tuple[int, ...], *, noise: NoiseSpec
) -> Image:
    """Images of `shape` [batch, row, column, channel] in one evaluation."""
    return denoise(jnp.zeros(shape), jnp.asarray(noise.sigma_max))


def regression_loss(
    key: Key[Array, ""],
    denoise: Denoiser,
    clean: Image,
    *,
    noise: NoiseSpec,
    range_weight: float = 1.0,
    step: int | Int[Array, ""] = 0,
) -> Float[Array, ""]:
    """Mean squared error of the estimate, as `LossSpec` weights its channels.

    `key` and `step` are not used.
    """
    estimate = regression_estimate(denoise, clean.shape, noise=noise)
    return jnp.mean(channel_weights(clean, range_weight) * (estimate - clean) ** 2)


def occupancy_loss(
    key: Key[Array, ""],
    denoise: Denoiser,
    clean: Image,
    *,
    noise: NoiseSpec,
    step: int | Int[Array, ""] = 0,
) -> Float[Array, ""]:
    """Squared error and Dice of pixels that are 0 or 1 (RadarHD, Prabhakara et al.).

    For the prediction "occupancy", whose estimate is a probability; Dice over each
    image. `key` and `step` are not used.
    """
    share = regression_estimate(denoise, clean.shape, noise=noise)
    both = (share * clean).sum((1, 2, 3))
    either = (share + clean).sum((1, 2, 3))
    dice = 1 - 2 * both / jnp.maximum(either, 1e-6)
    return jnp.mean((share - clean) ** 2) + dice.mean()
