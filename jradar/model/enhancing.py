"""The paper in three functions: condition, draw, and both as enhance."""

import functools
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float, Key, Num

from jradar.diffusion import Solver, conditional_denoiser
from jradar.model.methods import METHODS
from jradar.model.spec import Model, ModelSpec
from jradar.radar import RadarSpec, radar_points
from jradar.range_image import (
    CHANNELS,
    RangeImage,
    calibrated,
    condition_image,
    confident,
    image_cloud,
    velocity_image,
)
from jradar.types import PointCloud


@functools.partial(
    jax.jit, static_argnames=("radar", "range_bias_m", "draws", "steps", "solver")
)
def enhance(
    key: Key[Array, ""],
    cube: Num[Array, "tx rx chirp sample *pair"],
    model: Model,
    *,
    radar: RadarSpec | None = None,
    coupling: Complex[Array, "tx rx half_range"] | None = None,
    range_bias_m: float = 0.0,
    **drawing: Any,
) -> PointCloud:
    """Return the dense, LiDAR-like cloud of one radar frame (Fig. 3b).

    A frame without a point of `radar_points` in the view of the condition gives an
    empty cloud. At the false-alarm rate of 1 of the paper's models every cell with
    power is a point: only a frame of zeros is empty, a frame of noise is not.
    `drawing` are options of `draw`, the others are those of `condition`. One frame;
    `vmap` it.
    """
    sensor = {"radar": radar, "coupling": coupling, "range_bias_m": range_bias_m}
    points = _points(cube, model.spec, **sensor)
    image = draw(key, _image(points, model.spec), model, **drawing)
    return dense_cloud(image, points, model.spec)


@functools.partial(jax.jit, static_argnames=("radar", "range_bias_m"))
def condition(
    cube: Num[Array, "tx rx chirp sample *pair"],
    model: Model,
    *,
    radar: RadarSpec | None = None,
    coupling: Complex[Array, "tx rx half_range"] | None = None,
    range_bias_m: float = 0.0,
) -> Float[Array, "row column channel"]:
    """Return the network's input: the radar points of one frame as range images.

    `radar` is the sensor that recorded the cube, by default the model's own. `coupling`
    and `range_bias_m` are as in `radar_points`. One frame; `vmap` it. Raises ValueError
    for a cube that does not fit the radar.
    """
    sensor = {"radar": radar, "coupling": coupling, "range_bias_m": range_bias_m}
    return _image(_points(cube, model.spec, **sensor), model.spec)


@functools.partial(jax.jit, static_argnames=("draws", "steps", "solver"))
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

    A model of one pass and a regression model have one answer and take neither of the
    first four options. A diffusion model takes `draws` samples at once, 8 by default,
    and returns the range on which they agree (`agreed_range`). `draws=1` is the paper's
    single sample, and `draws=1, steps=1` its one-step estimate. Defaults for several
    draws: 5 steps of iPNDM, temperature 1; for one: 18 steps, the model's temperature,
    and the solver of `solver_for`: Heun, or iPNDM below 8 steps.

    Pixels of less than `least_confidence`, by default the model's, are dropped. Without
    a radar point in the condition the image is empty. One condition; `vmap` it. Raises
    ValueError for options that the model does not take.
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
    if image.confidence is not None and spec.calibration is not None:
        image = image._replace(
            confidence=calibrated(image.confidence, spec.calibration)
        )
    least = spec.least_confidence if least_confidence is None else least_confidence
    image = confident(image, least)
    return jax.tree.map(lambda value: jnp.where(condition.any(), value, 0.0), image)


@functools.partial(jax.jit, static_argnames="spec")
def dense_cloud(image: RangeImage, points: PointCloud, spec: ModelSpec) -> PointCloud:
    """Return the cloud of an image, with the velocities of the radar points near it."""
    velocity = velocity_image(
        image.range_m, points, spec.coarse, num_slices=spec.num_slices
    )
    return image_cloud(image, spec.fine)._replace(velocity=velocity.ravel())


def _points(cube, spec: ModelSpec, *, radar, coupling, range_bias_m) -> PointCloud:
    """The radar points of one frame."""
    points = spec.points if radar is None else spec.points.fitted(radar)
    return radar_points(
        cube,
        radar or spec.radar,
        points=points,
        coupling=coupling,
        range_bias_m=range_bias_m,
    )


def _image(points: PointCloud, spec: ModelSpec) -> Float[Array, "row column channel"]:
    """The condition that radar points make."""
    return condition_image(points, spec.coarse, num_slices=spec.num_slices)
