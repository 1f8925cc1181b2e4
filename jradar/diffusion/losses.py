"""Training losses (Eq. 9; Eq. 10 and 11 are still to come)."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Key

from jradar.diffusion.noise import NoiseSpec, loss_weight, training_sigma
from jradar.diffusion.precondition import Denoiser


def denoising_loss(
    key: Key[Array, ""],
    denoise: Denoiser,
    clean: Float[Array, "batch row column channel"],
    *,
    noise: NoiseSpec,
) -> Float[Array, ""]:
    """Mean weighted squared error ||x0 - D(x0 + sigma n; sigma)||^2 at random levels.

    The weight makes 1 the loss of a network that predicts nothing.
    """
    sigma_key, noise_key = jax.random.split(key)
    sigma = training_sigma(sigma_key, clean.shape[:1], noise)
    levels = sigma[:, None, None, None]
    noisy = clean + levels * jax.random.normal(noise_key, clean.shape, clean.dtype)
    error = denoise(noisy, sigma) - clean
    return jnp.mean(loss_weight(levels, noise) * error**2)
