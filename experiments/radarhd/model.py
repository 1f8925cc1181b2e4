"""What the task trains, and the methods by which its images are drawn.

The network predicts the probability of each pixel (`OCCUPANCY` of `jradar.diffusion`).
With the method "nearness" it answers in one pass, and predicts the expectation of how
near the closest LiDAR point is (`jradar.training.targets`).
"""

import functools
from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Key
from ml_collections import ConfigDict

from experiments import build
from jradar import diffusion
from jradar.compiled import jit
from jradar.diffusion import OCCUPANCY, NoiseSpec
from jradar.diffusion.solvers import solver_for
from jradar.errors import UsageError
from jradar.model import Model, ModelSpec, PolarGrid, load_model
from jradar.model.grids.polar import LIDAR, agreed_occupancy, one_pass

QUICK_STEPS = 5  # of each draw of those that have to agree
NEARNESS = "nearness"

Images = Float[Array, "batch range azimuth"]
Answers = Callable[[jax.Array, jax.Array], Iterator[tuple[str, Images]]]


def build_spec(config: ConfigDict) -> ModelSpec:
    """Return everything about the model except its weights.

    A network that was trained to draw, or by regression, answers as `config.answer`.
    """
    noise = build.build_noise(config, predictions={OCCUPANCY.name: OCCUPANCY})
    with build.section("network"):
        network = diffusion.build_network(**config.network)
    with build.section("data.history"):
        grid = PolarGrid(config.data.history)
    method = config.method if config.method in grid.methods else "occupancy"
    method = config.answer if method == "diffusion" else method
    with build.section("answer"):
        return ModelSpec(method, network, noise, grid)


def evaluated(name: str, config: ConfigDict, *, method: str) -> Model:
    """Return a model by its name or folder.

    Raises UsageError for one that does not see the config's radar images, or whose
    network gives nearness where a method needs occupancy, or the other way round.
    """
    model, wanted = load_model(name), PolarGrid(config.data.history)
    if model.spec.grid != wanted:
        raise UsageError(
            f"{name} sees {model.spec.grid}, expected {wanted}: change data.history, "
            "or name another model"
        )
    if (model.spec.method == NEARNESS) != (method == NEARNESS):
        raise UsageError(
            f"{name} has the method {model.spec.method!r}, expected one for "
            f"{method!r}: use the config that trained it, or name another model"
        )
    return model


def answers(config: ConfigDict, model: Model) -> Answers:
    """Return the function from a key and conditions to (method, images), in turn.

    The quickest method comes first.
    """
    draw, near = _drawing(model), None
    if config.method in ONE_PASS:
        return functools.partial(ONE_PASS[config.method], draw)
    if config.nearness:
        near = _drawing(evaluated(config.nearness, config, method=NEARNESS))
    steps, draws = config.sampling.steps, config.sampling.draws
    return functools.partial(_diffusion_answers, draw, near, steps, draws)


def _drawing(model: Model) -> Callable[..., Images]:
    """The function that draws images with a model's network."""
    spec = model.spec
    fixed = {"params": model.params, "network": spec.network, "noise": spec.noise}
    return functools.partial(draw_images, **fixed)


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


ONE_PASS = {NEARNESS: nearness_answers, "regression": _regression_answers}


@jit(static_argnames=("network", "noise", "steps"))
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
    denoise = diffusion.conditional_denoiser(network, params, noise)(condition)
    if steps is None:
        return one_pass(denoise, len(condition), noise)
    shape = (len(condition), *LIDAR.shape, 1)
    return diffusion.sample(key, denoise, shape, noise=noise, steps=steps)[..., 0]
