"""RadarHD's methods: functions from keys and conditions to occupancy images."""

import functools
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Key
from ml_collections import ConfigDict

from experiments import build
from experiments.radarhd.nearness import mirrored
from experiments.radarhd.occupancy import OCCUPANCY, agreed_occupancy
from experiments.radarhd.pairs import LIDAR, RADAR
from experiments.radarhd.scores import Draw
from experiments.weights import load_weights
from jradar import diffusion
from jradar.errors import ModelError

QUICK_STEPS = 8  # of each draw of those that have to agree


def networks(config: ConfigDict) -> tuple[diffusion.Network, diffusion.NoiseSpec]:
    """Return the network and its noise levels."""
    noise = build.build_noise(config, predictions={OCCUPANCY.name: OCCUPANCY})
    with build.section("network"):
        return diffusion.build_network(**config.network), noise


def quickest(draws: dict[str, Draw]) -> dict[str, Draw]:
    """Return the first method alone."""
    name = next(iter(draws))
    return {name: draws[name]}


def draw_methods(config: ConfigDict, params: dict) -> dict[str, Draw]:
    """Return functions (key, conditions) -> images by method, the quickest first."""
    network, noise = networks(config)

    def drawn(steps):
        return functools.partial(
            draw_images, params=params, network=network, noise=noise, steps=steps
        )

    if config.method == "regression":
        return {"direct regression": drawn(None)}
    if config.method == "nearness":
        both = functools.partial(mirrored, drawn(None))
        return {"one pass": drawn(None), "one pass and its mirror image": both}
    steps, draws = config.sampling.steps, config.sampling.draws
    solver = {"heun": "Heun", "ipndm3": "iPNDM"}[diffusion.solver_for(steps).name]
    methods = {
        "one-step estimate": drawn(1),
        "one pass from zero": drawn(None),
        f"diffusion, {solver} {steps}": drawn(steps),
    }
    if draws > 1:
        agreed = shared(functools.partial(agreed_images, drawn(QUICK_STEPS), draws))
        methods[f"{draws} draws"] = agreed
        if config.nearness.weights:
            near = nearness_images(config)
            both = functools.partial(mean_images, agreed, near)
            methods[f"{draws} draws and nearness"] = both
    return methods


def nearness_images(config: ConfigDict) -> Draw:
    """Return the one-pass method, mirror images included, of `config.nearness`."""
    with build.section("nearness.network"):
        network = diffusion.build_network(**config.nearness.network)
    path = Path(config.nearness.weights)
    one_pass = functools.partial(
        draw_images,
        params=fitting_weights(path, network, config.data.history),
        network=network,
        noise=networks(config)[1],
        steps=None,
    )
    return functools.partial(mirrored, one_pass)


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


def mean_images(first: Draw, second: Draw, key: jax.Array, condition: Any) -> jax.Array:
    """Return the mean of the images of two methods."""
    return (first(key, condition) + second(key, condition)) / 2


def shared(draw: Draw) -> Draw:
    """Return a method that draws once when it is called again with the same arrays."""
    last: list[Any] = [None, None, None]

    def images(key, condition):
        if last[0] is not key or last[1] is not condition:
            last[:] = key, condition, draw(key, condition)
        return last[2]

    return images


def agreed_images(draw: Draw, draws: int, key: jax.Array, condition: Any) -> jax.Array:
    """Return the share of draws that have an occupied pixel near each pixel."""
    keys = jax.random.split(key, draws)
    return agreed_occupancy(jnp.stack([draw(key, condition) for key in keys]))


@functools.partial(jax.jit, static_argnames=("network", "noise", "steps"))
def draw_images(
    key: Key[Array, ""],
    condition: Float[Array, "batch row column channel"],
    *,
    params: Any,
    network: diffusion.Network,
    noise: diffusion.NoiseSpec,
    steps: int | None,
) -> Float[Array, "batch lidar_row lidar_column"]:
    """Return an image for each condition: regressed if `steps` is None, else drawn."""
    denoise = diffusion.conditional_denoiser(network, params, noise)(condition)
    shape = (len(condition), *LIDAR.shape, 1)
    if steps is None:
        return diffusion.regression_estimate(denoise, shape, noise=noise)[..., 0]
    return diffusion.sample(key, denoise, shape, noise=noise, steps=steps)[..., 0]
