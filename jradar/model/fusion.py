"""Fuses frames: what each of them knows about the surfaces that the newest one sees.

A network of one pass knows, for each direction of its frame, how probable a surface is
at each range. With the radar's motion known, a point of the present frame has a
direction and a range in every earlier frame too, so each frame has a probability of a
surface there. The mean of these probabilities decides, as the mass of the distribution
does within a frame:

    candidate range of a pixel -> point -> direction and range in each frame
                               -> probability of a surface within the window, in each
                               -> mean over the frames that look that way

An object that moves by itself is now where earlier frames saw nothing. So pixels that
are marked as moving are left out of earlier frames, and use the present frame alone.
"""

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jradar.compiled import jit
from jradar.diffusion import (
    RangeMixture,
    conditional_denoiser,
    range_mixture,
    window_mass,
)
from jradar.errors import UsageError
from jradar.model.grids.view.answers import SIDE_STEPS, likeliest_range
from jradar.model.grids.view.grid import ViewGrid
from jradar.model.model import Model
from jradar.range_image import (
    RangeImage,
    confident,
    decode_range,
    encode_range,
    frequency,
    pixel_directions,
    pixel_of,
    project,
    velocity_image,
)
from jradar.types import PointCloud

SURE = 0.5  # confidence of earlier frames' points that are tried in the present one
MOVING_MPS = 0.6  # larger differences from the Doppler of a world at rest are motion


def view_grid(model: Model) -> ViewGrid:
    """Return the grid of a model whose frames can be fused.

    Raises UsageError for a model of another grid, or of another method than "marginal".
    """
    spec = model.spec
    if not isinstance(spec.grid, ViewGrid) or spec.method != "marginal":
        raise UsageError(
            f"the model answers by {spec.method}, expected marginal: a model of range "
            "images in one pass, such as jradar-sim, whose distributions over range "
            "are fused"
        )
    return spec.grid


@jit
def mixtures(
    condition: Float[Array, "row column channel"], model: Model
) -> RangeMixture:
    """Return the distributions over range of one frame's pixels; `vmap` it.

    Raises UsageError for a model of another method than "marginal".
    """
    spec, grid = model.spec, view_grid(model)
    denoise = conditional_denoiser(spec.network, model.params, spec.noise)
    shape = (1, *grid.image_shape)
    found = range_mixture(denoise(condition[None]), shape, noise=spec.noise)
    empty = ~condition.any()  # the radar sees nothing
    returned = jnp.where(empty, -math.inf, found.returned)
    return jax.tree.map(lambda values: values[0], found._replace(returned=returned))


@jit(static_argnames=("grid", "unambiguous_mps"))
def moving_pixels(
    mixture: RangeMixture,
    points: PointCloud,
    velocity: Float[Array, " 3"],
    grid: ViewGrid,
    *,
    unambiguous_mps: float | None = None,
) -> Bool[Array, "row column"]:
    """Return which pixels of one frame show what moves by itself; `vmap` it.

    Their radar points recede 0.6 m/s faster or slower than a world at rest does from a
    radar with this `velocity` in m/s. With `unambiguous_mps`, both are compared modulo
    twice that. All are False if the velocity is NaN.
    """
    range_m = likeliest_range(mixture, grid).range_m
    measured = velocity_image(range_m, points, grid.coarse, num_slices=grid.num_slices)
    at_rest = -jnp.asarray(pixel_directions(grid.fine), jnp.float32) @ velocity
    difference = measured - at_rest
    if unambiguous_mps is not None:
        period = 2 * unambiguous_mps
        difference -= period * jnp.round(difference / period)
    return jnp.abs(difference) > MOVING_MPS


@jit
def fuse(
    frames: RangeMixture,
    poses: Float[Array, "frame 4 4"],
    model: Model,
    *,
    moving: Bool[Array, "frame row column"] | None = None,
    least_confidence: float | Float[Array, ""] | None = None,
) -> RangeImage:
    """Return the present frame's range image, as all frames together see it.

    `frames` holds the `mixtures` of each frame, the present one first, and `poses` the
    transforms of points from each frame's radar to the present one's. A pose of NaN
    leaves its frame out. `moving` marks the `moving_pixels`. Confidences are calibrated
    and dropped as in `draw`. Raises ValueError if the number of poses is not that of
    the frames.

        frames = jax.vmap(mixtures, (0, None))(conditions, model)  # newest first
        image = fuse(frames, relative_poses(trajectory, [9, 8, 7], 9), model)
    """
    grid, count = view_grid(model), frames.returned.shape[0]
    if poses.shape != (count, 4, 4):
        raise ValueError(
            f"poses have shape {poses.shape}, expected {(count, 4, 4)}: one for each "
            "frame"
        )
    if moving is None:
        moving = jnp.zeros(frames.returned.shape, bool)
    present, *earlier = (
        jax.tree.map(lambda values, k=k: values[k], frames) for k in range(count)
    )
    past = range(1, count)
    tables = [_table(mixture) for mixture in earlier]
    directions = jnp.asarray(pixel_directions(grid.fine), jnp.float32)

    def probability(range_m):
        """Return the mean probability of a surface within the window around a range."""
        total = _surface(present, range_m, grid)
        views = jnp.ones_like(total)
        xyz = range_m[..., None] * directions
        for k, table in zip(past, tables, strict=True):
            there = (xyz - poses[k, :3, 3]) @ poses[k, :3, :3]
            row, column, distance, inside = pixel_of(there, grid.fine)
            seen = _from_table(table[row, column])
            counts = inside & ~moving[0] & ~moving[k][row, column] & (range_m > 0)
            total += jnp.where(counts, _surface(seen, distance, grid), 0.0)
            views += counts
        return total / views

    first = likeliest_range(present, grid).range_m
    candidates = [first]
    for k, mixture in zip(past, earlier, strict=True):
        seen = confident(likeliest_range(mixture, grid), SURE)
        shown = jnp.where(moving[k], 0.0, seen.range_m)
        xyz = (shown[..., None] * directions).reshape(-1, 3)
        here = xyz @ poses[k, :3, :3].T + poses[k, :3, 3]
        cloud = PointCloud(here, (shown > 0).ravel())
        candidates.append(project(cloud, grid.fine))
    heaviest = jax.lax.top_k(present.weight, 2)[1]
    centres = jnp.take_along_axis(present.centre, heaviest, -1)
    view = {"max_range_m": grid.fine.max_range_m, "codec": grid.codec}
    candidates += [decode_range(centres[..., k], **view) for k in range(2)]

    best, most = _likeliest(jnp.stack(candidates), probability)
    sides = [best + step * grid.fine.near_m for step in SIDE_STEPS]
    best, most = _likeliest(jnp.stack([best, *sides]), probability)
    table = model.tables.confidence
    most = frequency(most, table)
    least = table.least if least_confidence is None else least_confidence
    return confident(RangeImage(best, most), least)


def _likeliest(candidates, probability):
    """Return each pixel's likeliest candidate, the first of equals; its probability."""
    candidates = jnp.maximum(candidates, 0.0)
    found = jax.lax.map(probability, candidates)
    found = jnp.where(candidates > 0, found, 0.0)
    best = found.argmax(0)[None]
    return tuple(
        jnp.take_along_axis(values, best, 0)[0] for values in (candidates, found)
    )


def _surface(mixture, range_m, grid):
    """Return the probability of a return near a range."""
    view = {"max_range_m": grid.fine.max_range_m, "codec": grid.codec}
    window_m = grid.fine.near_m
    low, high = (encode_range(range_m + side, **view) for side in (-window_m, window_m))
    return jax.nn.sigmoid(mixture.returned) * window_mass(mixture)(low, high)


def _table(mixture):
    """Return each pixel's mixture in one array, so that one gather reads it."""
    parts = [mixture.returned[..., None], mixture.weight, mixture.centre, mixture.scale]
    return jnp.concatenate(parts, -1)


def _from_table(values):
    weight, centre, scale = jnp.split(values[..., 1:], 3, -1)
    return RangeMixture(values[..., 0], weight, centre, scale)
