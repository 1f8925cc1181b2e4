"""Training losses of pixels from 0 to 1: occupied or not, or a share between.

They are called as `denoising_loss` is. Like the squared error, the cross-entropy is
least where the network predicts the expectation. Its gradient does not vanish where the
network is sure and wrong.

occupancy_loss    cross-entropy of D(x; sigma) at random noise levels
estimate_loss     cross-entropy of the one-pass estimate
log_odds_loss     the same for a network that returns log-odds relative to SHARE
dice_loss         squared error and Dice of the one-pass estimate
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jradar.diffusion.losses import Image, regression_estimate
from jradar.diffusion.noise import NoiseSpec, training_sigma
from jradar.diffusion.occupancy import prior
from jradar.diffusion.precondition import Denoiser

SHARE = 0.03  # of occupied voxels in maps


def occupancy_loss(
    key: Any, denoise: Denoiser, clean: Image, *, noise: NoiseSpec
) -> Float[Array, ""]:
    """Return the cross-entropy at random noise levels, relative to the prior's."""
    sigma_key, noise_key = jax.random.split(key)
    sigma = training_sigma(sigma_key, clean.shape[:1], noise)
    unit = jax.random.normal(noise_key, clean.shape, clean.dtype)
    share = denoise(clean + sigma[:, None, None, None] * unit, sigma)
    return _relative_entropy(share, clean, noise)


def estimate_loss(
    key: Any, denoise: Denoiser, clean: Image, *, noise: NoiseSpec
) -> Float[Array, ""]:
    """Return the cross-entropy of the one-pass estimate, relative to the prior's.

    `key` is not used.
    """
    estimate = regression_estimate(denoise, clean.shape, noise=noise)
    return _relative_entropy(estimate, clean, noise)


def log_odds_loss(
    key: Any, denoise: Denoiser, clean: Image, *, noise: NoiseSpec
) -> Float[Array, ""]:
    """Return the cross-entropy of the log-odds of one pass: sums of channels, averaged.

    `key` is not used.
    """
    odds = log_odds(denoise, clean.shape, noise=noise)
    return (jax.nn.softplus(odds) - clean * odds).sum(-1).mean()


def dice_loss(
    key: Any, denoise: Denoiser, clean: Image, *, noise: NoiseSpec
) -> Float[Array, ""]:
    """Return squared error plus Dice of the one-pass estimate (Prabhakara et al. 2023).

    Dice is computed for each image. `key` is not used.
    """
    share = regression_estimate(denoise, clean.shape, noise=noise)
    both = (share * clean).sum((1, 2, 3))
    either = (share + clean).sum((1, 2, 3))
    dice = 1 - 2 * both / jnp.maximum(either, 1e-6)
    return jnp.mean((share - clean) ** 2) + dice.mean()


def log_odds(denoise: Denoiser, shape: tuple[int, ...], *, noise: NoiseSpec) -> Image:
    """Return the log-odds of each pixel of images of `shape`, from one pass.

    The network's output is relative to the log-odds of SHARE.
    """
    given: Any = jax.ShapeDtypeStruct(shape, jnp.float32)
    odds = denoise(given, jnp.asarray(noise.sigma_max))
    return odds + jnp.log(SHARE / (1 - SHARE))


def _relative_entropy(share, clean, noise):
    """The mean cross-entropy of pixels, relative to that of the prior."""
    share = jnp.clip(share, 1e-6, 1 - 1e-6)
    loss = -clean * jnp.log(share) - (1 - clean) * jnp.log1p(-share)
    start = jax.nn.sigmoid(prior(noise))
    entropy = -start * jnp.log(start) - (1 - start) * jnp.log1p(-start)
    return loss.mean() / entropy
