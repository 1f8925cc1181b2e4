"""Occupancy images: what the network predicts, its losses, and how images are drawn.

The prediction is `OCCUPANCY` of `jradar.diffusion`: the probability of each pixel.

With the method "nearness" the network answers in one pass, and predicts the expectation
of how near the closest LiDAR point is:

    nearness of a pixel = max(0, 1 - distance to the nearest occupied pixel / REACH_M)

Where a wall may lie a little nearer or farther, no single pixel is likely to be
occupied, but many are likely to be near it: pixels of a large expected nearness make a
cloud of small distances.
"""

import functools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Key
from ml_collections import ConfigDict

from experiments import build
from experiments.weights import load_weights
from jradar import diffusion
from jradar.diffusion import OCCUPANCY, Denoiser, NoiseSpec, regression_estimate
from jradar.diffusion.noise import training_sigma
from jradar.diffusion.occupancy import prior
from jradar.diffusion.solvers import solver_for
from jradar.errors import ModelError
from jradar.planar import LIDAR, MAX_RANGE_M, RADAR, one_pass

REACH_M = 0.3
RANGE_STEP_M = MAX_RANGE_M / (len(LIDAR.ranges) - 1)
REACH = int(REACH_M / RANGE_STEP_M)  # rows
FAR = 1e6  # a squared distance, or a number of columns, beyond all others
AGREED_PIXELS = 3  # rows and columns within which draws agree on an occupied pixel
QUICK_STEPS = 5  # of each draw of those that have to agree

Image = Float[Array, "batch row column channel"]
Images = Float[Array, "batch range azimuth"]
Answers = Callable[[jax.Array, jax.Array], Iterator[tuple[str, Images]]]


def denoising_loss(
    key: Any, denoise: Denoiser, clean: Image, *, noise: NoiseSpec
) -> Float[Array, ""]:
    """Return the cross-entropy at random noise levels, relative to the prior's.

    The denoiser of least cross-entropy is also that of least squared error, but the
    gradient of the cross-entropy does not vanish where the denoiser is sure and wrong.
    """
    sigma_key, noise_key = jax.random.split(key)
    sigma = training_sigma(sigma_key, clean.shape[:1], noise)
    unit = jax.random.normal(noise_key, clean.shape, clean.dtype)
    share = denoise(clean + sigma[:, None, None, None] * unit, sigma)
    return cross_entropy(share, clean, noise)


def regression_loss(
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


def nearness_loss(
    key: Any, denoise: Denoiser, clean: Image, *, noise: NoiseSpec
) -> Float[Array, ""]:
    """Return the cross-entropy of the one-pass estimate to the nearness of `clean`.

    It is least where the estimate is the expectation given the condition. `key` is not
    used.
    """
    estimate = regression_estimate(denoise, clean.shape, noise=noise)
    return cross_entropy(estimate, nearness(clean), noise)


LOSSES = {
    "diffusion": denoising_loss,
    "nearness": nearness_loss,
    "regression": regression_loss,
}


def cross_entropy(share: Image, clean: Image, noise: NoiseSpec) -> Float[Array, ""]:
    """Return the mean cross-entropy of pixels, relative to that of the prior."""
    share = jnp.clip(share, 1e-6, 1 - 1e-6)
    loss = -clean * jnp.log(share) - (1 - clean) * jnp.log1p(-share)
    start = jax.nn.sigmoid(prior(noise))
    entropy = -start * jnp.log(start) - (1 - start) * jnp.log1p(-start)
    return loss.mean() / entropy


@jax.jit
def nearness(occupied: Image) -> Image:
    """Return the nearness of each pixel of occupancy images on RadarHD's grid.

    Distances are exact, in the plane, between the middles of pixels. Raises ValueError
    for images of another size.
    """
    rows, columns = occupied.shape[-3:-1]
    if (rows, columns) != LIDAR.shape:
        raise ValueError(
            f"image has {rows} x {columns} pixels, expected {LIDAR.shape}, whose "
            "ranges and angles are known"
        )
    here, axis = occupied[..., 0] > 0.5, occupied.ndim - 2
    column = jnp.arange(columns, dtype=jnp.float32)
    last = jax.lax.cummax(jnp.where(here, column, -FAR), axis)
    following = jax.lax.cummin(jnp.where(here, column, FAR), axis, reverse=True)
    apart = jnp.minimum(column - last, following - column)  # along the row
    # The squared chord of that angle on a circle of radius 1.
    chord = 4 * jnp.sin(LIDAR.azimuth_step / 2 * jnp.minimum(apart, columns)) ** 2
    chord = jnp.where(apart < columns, chord, FAR)
    around = [(0, 0)] * (axis - 1) + [(REACH, REACH), (0, 0)]
    chord = jnp.pad(chord, around, constant_values=FAR)
    range_m = RANGE_STEP_M * jnp.arange(rows)[:, None]
    nearest = jnp.full(here.shape, FAR)
    for offset in range(-REACH, REACH + 1):
        first, other_m = REACH + offset, range_m + offset * RANGE_STEP_M
        there = jax.lax.slice_in_dim(chord, first, first + rows, axis=axis - 1)
        across = jnp.where(there < FAR, range_m * other_m * there, FAR)
        nearest = jnp.minimum(nearest, (offset * RANGE_STEP_M) ** 2 + across)
    return jnp.maximum(1 - jnp.sqrt(nearest) / REACH_M, 0)[..., None]


@jax.jit
def agreed_occupancy(
    draws: Float[Array, "draw *batch row column"],
) -> Float[Array, "*batch row column"]:
    """Return the share of draws that have an occupied pixel near each pixel.

    Near is in the square of `AGREED_PIXELS`. Pixels that no draw has are 0. This is the
    counterpart of `agreed_range` for images with any number of surfaces in a column; as
    there, the share is the confidence.
    """
    occupied = (draws > 0.5).astype(draws.dtype)
    window = (1,) * (draws.ndim - 2) + (AGREED_PIXELS, AGREED_PIXELS)
    near = jax.lax.reduce_window(
        occupied, 0.0, jax.lax.max, window, (1,) * draws.ndim, "SAME"
    )
    return jnp.where(occupied.any(0), near.mean(0), 0.0)


def networks(config: ConfigDict) -> tuple[diffusion.Network, NoiseSpec]:
    """Return the network and its noise levels."""
    noise = build.build_noise(config, predictions={OCCUPANCY.name: OCCUPANCY})
    with build.section("network"):
        return diffusion.build_network(**config.network), noise


def fitting_weights(path: Path, network: diffusion.Network, history: int) -> Any:
    """Return the parameters in a file.

    Raises ModelError without them, and for those of another network or history.
    """
    params = load_weights(path)
    wrong = diffusion.misfit(
        params,
        network,
        image_shape=(*LIDAR.shape, 1),
        condition_shape=(*RADAR.shape, history),
    )
    if wrong:
        raise ModelError(
            f"{path} does not fit the network with data.history = {history}: {wrong}"
        )
    return params


def answers(config: ConfigDict, params: Any) -> Answers:
    """Return the function from a key and conditions to (method, images), in turn.

    The quickest method comes first.
    """
    network, noise = networks(config)

    def drawing(params, network):
        fixed = {"params": params, "network": network, "noise": noise}
        return functools.partial(draw_images, **fixed)

    draw, near = drawing(params, network), None
    if config.method in ONE_PASS:
        return functools.partial(ONE_PASS[config.method], draw)
    if config.nearness.weights:
        with build.section("nearness.network"):
            network = diffusion.build_network(**config.nearness.network)
        path = Path(config.nearness.weights)
        near = drawing(fitting_weights(path, network, config.data.history), network)
    steps, draws = config.sampling.steps, config.sampling.draws
    return functools.partial(_diffusion_answers, draw, near, steps, draws)


def _diffusion_answers(draw, near, steps, draws, key, condition):
    """Estimates, a careful sample, and quick ones of the image and its mirror image."""
    solver = {"heun": "Heun", "ipndm3": "iPNDM"}[solver_for(steps).name]
    yield "one-step estimate", draw(key, condition, steps=1)
    yield "one pass from zero", draw(key, condition)
    yield f"diffusion, {solver} {steps}", draw(key, condition, steps=steps)
    if draws == 1:
        return
    either = draw, functools.partial(of_mirror_image, draw)
    quick = [
        either[number % 2](each, condition, steps=QUICK_STEPS)
        for number, each in enumerate(jax.random.split(key, draws))
    ]
    yield f"{draws} draws", (agreed := agreed_occupancy(jnp.stack(quick)))
    if near is not None:
        *_, (_, nearness) = nearness_answers(near, key, condition)
        yield f"{draws} draws and nearness", (agreed + nearness) / 2


def nearness_answers(
    draw: Callable[..., Images], key: jax.Array, condition: jax.Array
) -> Iterator[tuple[str, Images]]:
    """Yield the answer of one pass, and its mean with that to the mirror image.

    Left and right are alike to a radar that looks ahead, not to a trained network.
    """
    yield "one pass", (straight := draw(key, condition))
    mirrored = of_mirror_image(draw, key, condition)
    yield "one pass and its mirror image", (straight + mirrored) / 2


def of_mirror_image(
    draw: Callable[..., Images], key: jax.Array, condition: jax.Array, **options: Any
) -> Images:
    """Return what is drawn for the mirror image of a condition, mirrored back."""
    return draw(key, condition[:, :, ::-1], **options)[:, :, ::-1]


def _regression_answers(draw, key, condition):
    yield "direct regression", draw(key, condition)


ONE_PASS = {"nearness": nearness_answers, "regression": _regression_answers}


@functools.partial(jax.jit, static_argnames=("network", "noise", "steps"))
def draw_images(
    key: Key[Array, ""],
    condition: Float[Array, "batch row column channel"],
    *,
    params: Any,
    network: diffusion.Network,
    noise: NoiseSpec,
    steps: int | None = None,
) -> Images:
    """Return an image for each condition: of one pass if `steps` is None, or drawn."""
    if steps is None:
        return one_pass(condition, params, network, noise)
    denoise = diffusion.conditional_denoiser(network, params, noise)(condition)
    shape = (len(condition), *LIDAR.shape, 1)
    return diffusion.sample(key, denoise, shape, noise=noise, steps=steps)[..., 0]
