"""How a network of polar images answers: with an image of occupancy or nearness.

    condition [range, azimuth, image]    polar images of the radar, newest first
    -> image  [range, azimuth]           of it, and of its mirror image, mirrored back

diffusion   several samples, half of them of the mirror image, and the share that agree
occupancy   one pass: the probability of a LiDAR point in each pixel
nearness    one pass: how near the closest point is expected to be

Left and right are alike to a radar that looks ahead, but not to a trained network. So
the mean of both answers is better than either, and their disagreement says how far to
trust it.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jradar.compiled import jit
from jradar.diffusion import Denoiser, NoiseSpec, regression_estimate, sample
from jradar.model.grids.base import Answer, Question, no_draws
from jradar.model.grids.polar.axes import LIDAR
from jradar.model.mirror import disagreement

AGREED_PIXELS = 3  # rows and columns within which draws agree on an occupied pixel
QUICK_STEPS = 5  # of each of several draws


class PolarImage(NamedTuple):
    """An answer in the plane, and the polar image that the network saw last.

    `confidence` is the probability that a surface is within 0.2 m, 0 where it is less
    than the least confidence; `disagreement` is that of the answer and of the one to
    the mirror image.
    """

    confidence: Float[Array, "range azimuth"]
    radar: Float[Array, "range radar_azimuth"]
    disagreement: Float[Array, ""]


def one_pass(
    denoise: Denoiser, batch: int, noise: NoiseSpec
) -> Float[Array, "batch range azimuth"]:
    """Return the images of one evaluation of the network."""
    shape = (batch, *LIDAR.shape, 1)
    return regression_estimate(denoise, shape, noise=noise)[..., 0]


def pass_both_ways(asked: Question, grid: Any, **sampling: Any) -> PolarImage:
    """Return the mean of the answers to a condition and to its mirror image."""
    no_draws(sampling, "a model of one pass draws no samples")
    condition = asked.condition[None]
    both = jnp.concatenate([condition, condition[:, :, ::-1]])
    straight, mirrored = one_pass(asked.denoise(both), 2, asked.noise)
    mirrored = mirrored[:, ::-1]
    apart = disagreement(straight, mirrored)
    return PolarImage((straight + mirrored) / 2, asked.condition[..., 0], apart)


def draw_both_ways(
    asked: Question, grid: Any, *, draws: int = 8, steps: int | None = None, **how: Any
) -> PolarImage:
    """Return the share of draws that agree; half of them are of the mirror image."""
    if draws < 1:
        raise ValueError(f"{draws=}, expected 1 or more")
    condition, half = asked.condition[None], draws // 2
    how = {"steps": steps or (18 if draws == 1 else QUICK_STEPS), **how}
    keys = jax.random.split(asked.key)

    def drawn(key, seen, count):
        shape = (count, *LIDAR.shape, 1)
        return sample(key, asked.denoise(seen), shape, noise=asked.noise, **how)[..., 0]

    images = drawn(keys[0], condition, draws - half)
    apart = jnp.zeros(())
    if half:
        mirrored = drawn(keys[1], condition[:, :, ::-1], half)[:, :, ::-1]
        shares = (jnp.clip(some.mean(0), 0.0) for some in (images, mirrored))
        apart = disagreement(*shares)
        images = jnp.concatenate([images, mirrored])
    return PolarImage(agreed_occupancy(images), asked.condition[..., 0], apart)


METHODS: dict[str, Answer] = {
    "diffusion": draw_both_ways,
    "occupancy": pass_both_ways,
    "nearness": pass_both_ways,
}


@jit
def agreed_occupancy(
    draws: Float[Array, "draw *batch row column"],
) -> Float[Array, "*batch row column"]:
    """Return the share of draws that have an occupied pixel near each pixel.

    Near means in the square of `AGREED_PIXELS`. Pixels that no draw has are 0. This is
    the counterpart of `agreed_range` for images with any number of surfaces in a
    column. There too, the share is the confidence.
    """
    occupied = (draws > 0.5).astype(draws.dtype)
    window = (1,) * (draws.ndim - 2) + (AGREED_PIXELS, AGREED_PIXELS)
    near = jax.lax.reduce_window(
        occupied, 0.0, jax.lax.max, window, (1,) * draws.ndim, "SAME"
    )
    return jnp.where(occupied.any(0), near.mean(0), 0.0)
