"""The paper in four functions: condition, draw, and both from a cube or from points."""

import dataclasses
from typing import Any, Unpack

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Inexact, Key

from jradar.compiled import jit
from jradar.diffusion import conditional_denoiser
from jradar.model.grids.base import Question
from jradar.model.model import Model, ModelSpec
from jradar.options.drawing import STATIC, Drawing, given
from jradar.radar import (
    Radar,
    calibrate,
    excise_interference,
    points_and_count,
)
from jradar.radar.samples import Cube
from jradar.range_image import frequency
from jradar.types import PointCloud


@jit(static_argnames=STATIC)
def enhance(
    key: Key[Array, ""],
    cube: Cube,
    radar: Radar,
    model: Model,
    **drawing: Unpack[Drawing],
) -> PointCloud:
    """Return the dense, LiDAR-like cloud of one radar frame (Fig. 3b).

    The options are those of `draw`. A frame without a point of `radar_points` in the
    view of the condition gives an empty cloud. The paper's models have a false-alarm
    rate of 1: every cell with power is a point, so only a frame of zeros is empty. One
    frame; `vmap` it. Raises ValueError for a model of maps.

    Gradients are exact with respect to the model's parameters and to the powers and
    ranges of the radar's points. Which cells become points, the pixel of a point and
    the component of the mixture that a pixel shows are choices without a gradient. So
    the phase of a channel, which acts only through directions, has no gradient either.
    """
    samples, points = _observed(cube, radar, model.spec)
    seen = model.spec.frame_grid.condition(samples, points, radar.spec)
    return _enhanced(key, seen, points, model, drawing)


@jit(static_argnames=STATIC)
def enhance_points(
    key: Key[Array, ""], points: PointCloud, model: Model, **drawing: Unpack[Drawing]
) -> PointCloud:
    """Return the dense cloud of a radar's points, whatever detector found them.

    The options are those of `draw`. Points without power count as equally strong; the
    result has velocities if the points have. A model saw the points of its
    `spec.points` in training: the more another detector's differ, the less its cloud is
    to be trusted. The cloud of no points is empty. One cloud; `vmap` it. Raises
    ValueError for a model that sees no points.
    """

    def enhanced(key, points, model):
        seen = model.spec.frame_grid.condition(None, points, None)
        return _enhanced(key, seen, points, model, drawing)

    if points.valid.size:
        return enhanced(key, points, model)
    empty = jax.eval_shape(enhanced, key, points, model)  # XLA would take a minute
    return jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), empty)


@jit
def condition(
    cube: Cube, radar: Radar, model: Model
) -> Float[Array, "row column channel"]:
    """Return what the network is given of one frame, such as its points as images.

    One frame; `vmap` it. Raises ValueError for a cube that does not fit the radar.
    """
    samples, points = _observed(cube, radar, model.spec)
    return model.spec.frame_grid.condition(samples, points, radar.spec)


@jit(static_argnames=STATIC)
def draw(
    key: Key[Array, ""],
    condition: Float[Array, "row column channel"],
    model: Model,
    **drawing: Unpack[Drawing],
) -> Any:
    """Return the image that the model draws of a condition, with its confidence.

    A model of range images gives a `RangeImage` in metres, 0 where nothing is seen; one
    of polar images a `PolarImage`; one of maps the probability of each voxel.

    A diffusion model draws `draws` samples at once, 8 by default, and returns what they
    agree on. `draws=1` is the paper's single sample, `draws=1, steps=1` its one-step
    estimate. Several draws take 5 steps of iPNDM at temperature 1 by default. One draw
    takes 18 steps at the model's temperature with the solver of `solver_for`. Other
    models have none of these options. Pixels of less than `least_confidence`, by
    default the model's, are dropped. Without a radar point in the condition, the image
    is empty. One condition; `vmap` it. Raises ValueError for options that the model
    does not take.
    """
    spec, grid = model.spec, model.spec.grid
    grid.check(condition.shape)
    asked = Question(
        key,
        conditional_denoiser(spec.network, model.params, spec.noise),
        condition,
        spec.noise,
        spec.temperature,
    )
    sampling = given(drawing)
    least = sampling.pop("least_confidence", None)
    image = grid.answer(spec.method, asked, **sampling)
    image = grid.calibrated(image, model.tables)
    return grid.kept(image, least, model.tables, condition)


@jit(static_argnames="fused")
def dense_cloud(
    image: Any,
    points: PointCloud,
    model: Model,
    *,
    least_confidence: float | Float[Array, ""] | None = None,
    fused: bool = False,
) -> PointCloud:
    """Return the points of an image, and the points around the radar's points.

    First come the points of the pixels. Those that no point of the radar supports need
    the model's `least_alone` confidence. They do not need it if `least_confidence` is
    given for all points, or if the image is `fused` from several frames, because
    `points` does not hold all their echoes. Then come the surroundings of the radar's
    points, if the model has a table of their confidence.
    """
    grid, tables = model.spec.frame_grid, model.tables
    added = None
    if (echoes := tables.echoes) is not None:
        around = grid.surroundings(points)
        crowded = jnp.asarray(around.confidence)
        found = jnp.where(around.valid, frequency(crowded, echoes), 0.0)
        least = grid.least(found, echoes)
        least = least if least_confidence is None else least_confidence
        kept = around.valid & (found >= least)
        found = jnp.where(kept, found, 0.0)
        added = around._replace(valid=kept, confidence=found)
    cloud = grid.cloud(image, points)
    if least_confidence is None and not fused and cloud.confidence is not None:
        sure = grid.near(cloud, points, added)
        sure |= cloud.confidence >= tables.confidence.least_alone
        confidence = jnp.where(sure, cloud.confidence, 0.0)
        cloud = cloud._replace(valid=cloud.valid & sure, confidence=confidence)
    if added is None:
        return cloud
    if cloud.confidence is None:  # of a single draw
        added = added._replace(confidence=None)
    return jax.tree.map(lambda *parts: jnp.concatenate(parts), cloud, added)


def _enhanced(key, condition, points, model: Model, drawing) -> PointCloud:
    """Return the cloud of a frame's condition and points."""
    image = draw(key, condition, model, **drawing)
    least = drawing.get("least_confidence")
    return dense_cloud(image, points, model, least_confidence=least)


def _observed(
    cube: Cube, radar: Radar, spec: ModelSpec
) -> tuple[Inexact[Array, "tx rx chirp sample"], PointCloud]:
    """Return the calibrated samples of a frame, and its points as in training."""
    points = spec.points.fitted(radar.spec)
    samples = calibrate(cube, radar)
    if points.remove_interference:
        samples, _ = excise_interference(samples)
        points = dataclasses.replace(points, remove_interference=False)
    return samples, points_and_count(samples, radar.once_calibrated(), points=points)[0]
