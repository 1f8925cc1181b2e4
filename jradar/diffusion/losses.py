"""Training losses (Eq. 9-12): L = squared L_m + perceptual L_p + absolute L_c.

L_m   EDM-weighted squared error, over all noise levels (Eq. 9)
L_p   a perceptual distance of the first channel, for example LPIPS (Eq. 10)
L_c   absolute error |x0 - D| of each pixel (Eq. 11)

Regression is the baseline: the same network without the diffusion. It sees only the
condition, and its estimate is D(0; sigma_max), where the preconditioning passes the
network's output through. Trained with the squared error, the estimate approaches the
mean of all images that the condition allows, and is blurred where these differ.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Key

from jradar.diffusion.noise import NoiseSpec, training_sigma
from jradar.diffusion.precondition import Denoiser

Image = Float[Array, "batch row column channel"]
Perceptual = Callable[[Image, Image], Float[Array, " batch"]]


@dataclasses.dataclass(frozen=True)
class LossSpec:
    """Weights of the terms of Eq. 12.

    The squared error of the first channel, the range, counts `range_weight` times as
    much as the squared error of another channel.
    """

    squared: float = 1.0
    range_weight: float = 1.0
    perceptual: float = 0.0
    absolute: float = 0.0

    def __post_init__(self):
        if not self.range_weight > 0:
            raise ValueError(f"range_weight = {self.range_weight}, expected above 0")
        for name in ("squared", "perceptual", "absolute"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} = {getattr(self, name)}, expected 0 or more")


SQUARED = LossSpec()  # Eq. 9 alone
LEAST_KNOWN = 0.05  # of an image, for its weight


def denoising_loss(
    key: Key[Array, ""],
    denoise: Denoiser,
    clean: Image,
    *,
    noise: NoiseSpec,
    weights: LossSpec = SQUARED,
    perceptual: Perceptual | None = None,
) -> Float[Array, ""]:
    """Return Eq. 12 for images `clean` at random noise levels.

    The squared error of a network that returns 0 everywhere is 1 on average.
    `perceptual` is a distance of two batches of images, such as
    `functools.partial(lpips, load_lpips())`. Raises ValueError for a perceptual weight
    without a distance, and for a prediction that is not an image.
    """
    if not noise.prediction.gives_image:
        raise ValueError(
            f"prediction {noise.prediction.name!r} gives a distribution of each pixel, "
            "expected one that gives an image: train it with mixture_loss"
        )
    sigma_key, noise_key = jax.random.split(key)
    sigma = training_sigma(sigma_key, clean.shape[:1], noise)
    levels = sigma[:, None, None, None]
    noisy = clean + levels * jax.random.normal(noise_key, clean.shape, clean.dtype)
    estimate = denoise(noisy, sigma)
    error = estimate - clean
    weight = noise.prediction.loss_weight(levels, noise.sigma_data)
    square = channel_weights(clean, weights.range_weight) * error**2
    loss = weights.squared * (weight * square).mean()
    if weights.absolute:
        loss += weights.absolute * jnp.abs(error).mean()
    if weights.perceptual:
        if perceptual is None:
            raise ValueError(
                f"perceptual weight {weights.perceptual} without a distance: pass "
                "perceptual=functools.partial(lpips, load_lpips())"
            )
        distance = perceptual(clean[..., :1], estimate[..., :1])
        loss += weights.perceptual * distance.mean()
    return loss


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
) -> Float[Array, ""]:
    """Return the mean squared error of the estimate, weighted as by `LossSpec`.

    It is called as `denoising_loss` is; `key` is not used.
    """
    estimate = regression_estimate(denoise, clean.shape, noise=noise)
    return jnp.mean(channel_weights(clean, range_weight) * (estimate - clean) ** 2)


def where_known(loss: Callable[..., jax.Array], **options: Any) -> Callable[..., Any]:
    """Return the loss without an error where the validity of `clean` is 0.

    There it is unknown what a scan would see. Squared errors of an image are divided
    by the share of its pixels that are known, so that sparse scans count as dense ones
    do. `options` are passed on to `loss`.
    """

    def known(key: Any, denoise: Any, clean: Any, **given: Any) -> jax.Array:
        root = jnp.sqrt(1 / known_share(clean))[:, None, None, None]

        def answer(x: Any, sigma: Any) -> Any:
            error = root * (denoise(x, sigma) - clean)
            return clean + jnp.where(clean[..., 1:] != 0, error, 0.0)

        return loss(key, answer, clean, **options, **given)

    return known


def known_share(clean: Image) -> Float[Array, " batch"]:
    """Return the share of the pixels of each image whose validity is not 0.

    It is at least LEAST_KNOWN.
    """
    return jnp.maximum(jnp.mean(clean[..., 1] != 0, axis=(1, 2)), LEAST_KNOWN)


def channel_weights(image: Image, range_weight: float) -> Float[Array, "1 1 1 channel"]:
    """Return the weight of each channel of `image`; the weights have mean 1.

    The first channel weighs `range_weight` times as much as every other.
    """
    channels = image.shape[-1]
    weights = jnp.ones((1, 1, 1, channels), image.dtype)
    weights = weights.at[..., 0].set(range_weight)
    return weights * (channels / (range_weight + channels - 1))
