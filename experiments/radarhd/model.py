"""Occupancy images: what the network predicts, and how images are drawn.

The prediction is `OCCUPANCY` of `jradar.diffusion`: the probability of each pixel. With
the method "nearness" the network answers in one pass, and predicts the expectation of
how near the closest LiDAR point is (`jradar.training.targets`).
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
from jradar.diffusion import OCCUPANCY, NoiseSpec
from jradar.diffusion.solvers import solver_for
from jradar.errors import ModelError
from jradar.planar import LIDAR, RADAR, one_pass

AGREED_PIXELS = 3  # rows and columns within which draws agree on an occupied pixel
QUICK_STEPS = 5  # of each draw of those that have to agree

Images = Float[Array, "batch range azimuth"]
Answers = Callable[[jax.Array, jax.Array], Iterator[tuple[str, Images]]]


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
