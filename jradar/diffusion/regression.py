"""Direct regression: the denoiser's network without the diffusion, as a baseline.

The network sees only the condition. Its estimate is D(0; sigma_max), where the
preconditioning passes the network's output through. Trained with the squared error, the
estimate approaches the mean of all images that the condition allows, and is blurred
where these differ.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Key

from jradar.diffusion.losses import channel_weights
from jradar.diffusion.noise import NoiseSpec
from jradar.diffusion.precondition import Denoiser

Image = Float[Array, "batch row column channel"]


def regression_estimate(
    denoise: Denoiser, shape: tuple[int, ...], *, noise: NoiseSpec
) -> Image:
    """Return images of `shape` [batch, row, column, channel] from one evaluation."""
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
    """Return the mean squared error of the estimate, weighted as by `LossSpec`.

    It is called as `denoising_loss` is; `key` and `step` are not used.
    """
    estimate = regression_estimate(denoise, clean.shape, noise=noise)
    return jnp.mean(channel_weights(clean, range_weight) * (estimate - clean) ** 2)
