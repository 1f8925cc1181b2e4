"""The paper in four functions: condition, draw, and both from a cube or from points."""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Key, Num

from jradar.diffusion import Solver, conditional_denoiser
from jradar.model.methods import METHODS
from jradar.model.spec import Model, ModelSpec
from jradar.radar import Radar, radar_points
from jradar.range_image import (
    CHANNELS,
    RangeImage,
    condition_image,
    confident,
    crowding,
    frequency,
    image_cloud,
    near_echo,
    surroundings,
    velocity_image,
)
from jradar.types import PointCloud

DRAWING = ("draws", "steps", "solver")


@functools.partial(jax.jit, static_argnames=DRAWING)
def enhance(
    key: Key[Array, ""],
    cube: Num[Array, "tx rx chirp sample *pair"],
    radar: Radar,
    model: Model,
    *,
    draws: int | None = None,
    steps: int | None = None,
    solver: Solver | None = None,
    temperature: float | Float[Array, ""] | None = None,
    least_confidence: float | Float[Array, ""] | None = None,
) -> PointCloud:
    """Return the dense, LiDAR-like cloud of one radar frame (Fig. 3b).

    The options are those of `draw`. A frame without a point of `radar_points` in the
    view of the condition gives an empty cloud. At the false-alarm rate of 1 of the
    paper's models every cell with power is a point: only a frame of zeros is empty, a
    frame of noise is not. One frame; `vmap` it.

    Gradients are exact with respect to the model's parameters and to the powers and
    ranges of the radar's points. Which cells become points, the pixel of a point and
    the component of the mixture that a pixel shows are choices: they have no gradient,
    so neither has the phase of a channel, which acts through directions alone.
    """
    return enhance_points(
        key,
        _points(cube, radar, model.spec),
        model,
        draws=draws,
        steps=steps,
        solver=solver,
        temperature=temperature,
        least_confidence=least_confidence,
    )


@functools.partial(jax.jit, static_argnames=DRAWING)
def enhance_points(
    key: Key[Array, ""],
    points: PointCloud,
    model: Model,
    *,
    draws: int | None = None,
    steps: int | None = None,
    solver: Solver | None = None,
    temperature: float | Float[Array, ""] | None = None,
    least_confidence: float | Float[Array, ""] | None = None,
) -> PointCloud:
    """Return the dense cloud of a radar's points, whatever detector found them.

    The options are those of `draw`. Points without power count as equally strong; the
    result has velocities if the points have. A model saw the points of its
    `spec.points` in training: the more another detector's differ, the less its cloud is
    to be trusted. One cloud; `vmap` it.
    """
    image = draw(
        key,
        _image(points, model.spec),
        model,
        draws=draws,
        steps=steps,
        solver=solver,
        temperature=temperature,
        least_confidence=least_confidence,
    )
    return dense_cloud(image, points, model, least_confidence=least_confidence)


@jax.jit
def condition(
    cube: Num[Array, "tx rx chirp sample *pair"], radar: Radar, model: Model
) -> Float[Array, "row column channel"]:
    """Return the network's input: the radar points of one frame as range images.

    One frame; `vmap` it. Raises ValueError for a cube that does not fit the radar.
    """
    return _image(_points(cube, radar, model.spec), model.spec)


@functools.partial(jax.jit, static_argnames=DRAWING)
def draw(
    key: Key[Array, ""],
    condition: Float[Array, "row column channel"],
    model: Model,
    *,
    draws: int | None = None,
    steps: int | None = None,
    solver: Solver | None = None,
    temperature: float | Float[Array, ""] | None = None,
    least_confidence: float | Float[Array, ""] | None = None,
) -> RangeImage:
    """Return a LiDAR-like range image in metres, 0 where nothing is seen.

    A diffusion model takes `draws` samples at once, 8 by default, and returns the range
    on which they agree. `draws=1` is the paper's single sample, `draws=1, steps=1` its
    one-step estimate. Defaults for several draws: 5 steps of iPNDM, temperature 1; for
    one: 18 steps, the model's temperature, and the solver of `solver_for`. Other models
    take none of these. Pixels of less than `least_confidence`, by default the model's,
    are dropped. Without a radar point in the condition the image is empty. One
    condition; `vmap` it. Raises ValueError for options that the model does not take.
    """
    spec = model.spec
    expected = *spec.coarse.shape, len(CHANNELS) * spec.num_slices
    if condition.shape != expected:
        raise ValueError(
            f"condition has shape {condition.shape}, the model needs [row, column, "
            f"channel] = {expected}: one condition, or another model's?"
        )
    denoise = conditional_denoiser(spec.network, model.params, spec.noise)
    options = {
        "draws": draws,
        "steps": steps,
        "solver": solver,
        "temperature": temperature,
    }
    given = {name: value for name, value in options.items() if value is not None}
    image = METHODS[spec.method](key, denoise(condition[None]), spec, **given)
    table = model.confidence
    if image.confidence is not None:
        image = image._replace(confidence=frequency(image.confidence, table))
    least = table.least if least_confidence is None else least_confidence
    image = confident(image, least)
    return jax.tree.map(lambda value: jnp.where(condition.any(), value, 0.0), image)


@functools.partial(jax.jit, static_argnames="fused")
def dense_cloud(
    image: RangeImage,
    points: PointCloud,
    model: Model,
    *,
    least_confidence: float | Float[Array, ""] | None = None,
    fused: bool = False,
) -> PointCloud:
    """Return the cloud of an image, and of what is around the radar's points.

    Pixels that are not `near_echo` need the model's `least_alone` confidence, unless
    `least_confidence` was asked of all, or the image is `fused` of several frames: not
    all their echoes are in `points`. After the pixels come the `surroundings` of the
    radar's points, if the model has a table of their confidence. Points have the
    velocities of the radar's points near them.
    """
    spec, echoes = model.spec, model.echoes
    if least_confidence is None and not fused and image.confidence is not None:
        near = near_echo(image.range_m, points, spec.fine)
        least = jnp.where(near, 0.0, model.confidence.least_alone)
        image = confident(image, least)
    cloud = image_cloud(image, spec.fine)
    if points.velocity is not None:
        velocity = velocity_image(
            image.range_m, points, spec.coarse, num_slices=spec.num_slices
        )
        cloud = cloud._replace(velocity=velocity.ravel())
    if echoes is None:
        return cloud
    found = frequency(crowding(points, spec.fine), echoes)
    least = echoes.least if least_confidence is None else least_confidence
    kept = points._replace(valid=points.valid & (found >= least), confidence=found)
    added = surroundings(kept, spec.fine)
    if cloud.confidence is None:  # of a single draw
        added = added._replace(confidence=None)
    return jax.tree.map(lambda *parts: jnp.concatenate(parts), cloud, added)


def _points(cube, radar: Radar, spec: ModelSpec) -> PointCloud:
    """The radar points of one frame, as the model saw them in training."""
    return radar_points(cube, radar, points=spec.points.fitted(radar.spec))


def _image(points: PointCloud, spec: ModelSpec) -> Float[Array, "row column channel"]:
    """The condition that radar points make."""
    return condition_image(points, spec.coarse, num_slices=spec.num_slices)
