"""Training losses (Eq. 9-12): L = squared L_m + perceptual L_p + absolute L_c.

L_m   EDM-weighted squared error, over all noise levels (Eq. 9)
L_p   a perceptual distance of the first channel, for example LPIPS (Eq. 10)
L_c   absolute error |x0 - D| of each pixel (Eq. 11)

L_p and L_c compare images. `LossSpec` can limit them to weak noise, at which the
denoised image still resembles the clean one.

Regression is the baseline: the same network without the diffusion. It sees only the
condition, and its estimate is D(0; sigma_max), where the preconditioning passes the
network's output through. Trained with the squared error, the estimate approaches the
mean of all images that the condition allows, and is blurred where these differ.
"""

import dataclasses
import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Key

from jradar.diffusion.noise import NoiseSpec, training_sigma
from jradar.diffusion.precondition import Denoiser

Image = Float[Array, "batch row column channel"]
Perceptual = Callable[[Image, Image], Float[Array, " batch"]]


@dataclasses.dataclass(frozen=True)
class LossSpec:
    """Weights of the terms of Eq. 12.

    Perceptual and absolute errors count only at noise levels below `below_sigma`. The
    squared error of the first channel, the range, counts `range_weight` times as much
    as the squared error of another channel. The perceptual term is computed at every
    `perceptual_every`-th step, with its weight multiplied by that number.
    """

    squared: float = 1.0
    range_weight: float = 1.0
    perceptual: float = 0.0
    absolute: float = 0.0
    below_sigma: float = math.inf
    perceptual_every: int = 1

    def __post_init__(self):
        """Refuse weights below 0 and intervals below 1."""
        if not self.range_weight > 0:
            raise ValueError(f"range_weight = {self.range_weight}, expected above 0")
        for name in ("squared", "perceptual", "absolute"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} = {getattr(self, name)}, expected 0 or more")
        if self.perceptual_every < 1:
            raise ValueError(
                f"perceptual_every = {self.perceptual_every}, expected 1 or more"
            )


SQUARED = LossSpec()  # Eq. 9 alone


def denoising_loss(
    key: Key[Array, ""],
    denoise: Denoiser,
    clean: Image,
    *,
    noise: NoiseSpec,
    weights: LossSpec = SQUARED,
    mask: Image | None = None,
    perceptual: Perceptual | None = None,
    step: int | Int[Array, ""] = 0,
) -> Float[Array, ""]:
    """Return Eq. 12 for images `clean` at random noise levels.

    Values where `mask` is 0 do not count. The squared error of a network that returns 0
    everywhere is 1 on average. `perceptual` is a distance of two batches of images,
    such as `functools.partial(lpips, load_lpips())`; `step` is the number of the
    training step. Raises ValueError for a perceptual weight without a distance, and for
    a prediction that is not an image.
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
    error = denoise(noisy, sigma) - clean
    counts = jnp.ones_like(clean) if mask is None else mask
    error *= counts
    total = counts.sum((1, 2, 3)).mean()
    per_value = jnp.maximum(total, 1) * len(clean)
    near = jnp.where(sigma < weights.below_sigma, 1.0, 0.0)

    weight = noise.prediction.loss_weight(levels, noise)
    square = channel_weights(clean, weights.range_weight) * error**2
    loss = weights.squared * (weight * square).sum() / per_value
    if weights.absolute:
        distance = (near[:, None, None, None] * jnp.abs(error)).sum() / per_value
        loss += weights.absolute * distance
    if weights.perceptual:
        if perceptual is None:
            raise ValueError(
                f"perceptual weight {weights.perceptual} without a distance: pass "
                "perceptual=functools.partial(lpips, load_lpips())"
            )
        every = weights.perceptual_every
        images = clean[..., :1], (clean + error)[..., :1]
        distance = _when(jnp.asarray(step) % every == 0, perceptual, *images)
        loss += weights.perceptual * every * (near * distance).mean()
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
    step: int | Int[Array, ""] = 0,
) -> Float[Array, ""]:
    """Return the mean squared error of the estimate, weighted as by `LossSpec`.

    It is called as `denoising_loss` is; `key` and `step` are not used.
    """
    estimate = regression_estimate(denoise, clean.shape, noise=noise)
    return jnp.mean(channel_weights(clean, range_weight) * (estimate - clean) ** 2)


def channel_weights(image: Image, range_weight: float) -> Float[Array, "1 1 1 channel"]:
    """Return the weight of each channel of `image`; the weights have mean 1.

    The first channel weighs `range_weight` times as much as every other.
    """
    channels = image.shape[-1]
    weights = jnp.ones((1, 1, 1, channels), image.dtype)
    weights = weights.at[..., 0].set(range_weight)
    return weights * (channels / (range_weight + channels - 1))


def _when(due, distance, *images):
    """`distance(*images)` if it is due, else 0 without computing it."""
    return jax.lax.cond(
        due, distance, lambda a, b: jnp.zeros(a.shape[:1], a.dtype), *images
    )


def target_mask(target: Image) -> Image:
    """Return 1 for values that count, 0 for the range of pixels without a return."""
    hit = (target[..., 1:2] > 0).astype(target.dtype)
    return jnp.concatenate([hit, jnp.ones_like(target[..., 1:])], -1)
