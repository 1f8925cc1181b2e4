"""Points to range images that keep the nearest point of each pixel, and back.

An image holds metres, and 0 where no point fell. Slices are equal parts of the range
axis, each with an image of its own, so that near points do not hide far ones (section
IV-B). One cloud at a time; `vmap` it: batches of clouds are refused.

The ranges and powers in an image are differentiable with respect to the point that each
pixel holds. Which pixel a point falls into is not. A rotation of the cloud moves points
along pixels but does not change an image's values, so the gradient with respect to
angles is 0.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jradar.compiled import jit
from jradar.range_image.grid import ImageSpec, pixel_directions, pixel_of
from jradar.types import PointCloud, check_one_cloud


class RangeImage(NamedTuple):
    """Ranges in metres, 0 for a miss, and how far to trust each of them, 0 to 1.

    The confidence is the probability that a surface is within a window around the
    range, as far as the method knows it; None for a method that does not.
    """

    range_m: Float[Array, "*batch row column"]
    confidence: Float[Array, "*batch row column"] | None = None


class SliceImages(NamedTuple):
    """The nearest point of each pixel and slice, 0 without a point.

    Units are metres, linear power and metres per second; velocity is None if it was not
    measured.
    """

    range_m: Float[Array, "*batch row column slice"]
    power: Float[Array, "*batch row column slice"]
    velocity: Float[Array, "*batch row column slice"] | None = None


@jit(static_argnames="spec")
def project(cloud: PointCloud, spec: ImageSpec) -> Float[Array, "row column"]:
    """Return the range image of a cloud in metres, 0 where no point fell."""
    check_one_cloud(cloud, "project")
    row, column, distance, inside = pixel_of(cloud.xyz, spec)
    size = spec.height * spec.width
    pixel = jnp.where(inside & cloud.valid, row * spec.width + column, size)
    nearest = _scatter_min(distance, pixel, size)
    return _zero_if_empty(nearest).reshape(spec.shape)


@jit(static_argnames=("spec", "num_slices"))
def project_slices(
    cloud: PointCloud, spec: ImageSpec, *, num_slices: int
) -> SliceImages:
    """Return a range image of each of `num_slices` equal parts of the range axis.

    A cloud without power has power 1. Of equally near points in a pixel, the power and
    velocity of the strongest are kept.
    """
    check_one_cloud(cloud, "project_slices")
    if num_slices < 1:
        raise ValueError(f"{num_slices=}, expected 1 or more")
    pixel, distance, inside = _slice_pixels(cloud, spec, num_slices)
    shape = (*spec.shape, num_slices)
    size = math.prod(shape)
    nearest = _scatter_min(distance, jnp.where(inside, pixel, size), size)

    wins = inside & (distance == nearest[pixel])
    power = jnp.isfinite(nearest).astype(distance.dtype)
    if cloud.power is not None:
        strongest = -_scatter_min(-cloud.power, jnp.where(wins, pixel, size), size)
        wins &= cloud.power == strongest[pixel]
        power = _zero_if_empty(strongest)
    velocity = cloud.velocity
    if velocity is not None:
        velocity = _scatter_min(velocity, jnp.where(wins, pixel, size), size)
        velocity = _zero_if_empty(velocity).reshape(shape)
    return SliceImages(
        _zero_if_empty(nearest).reshape(shape), power.reshape(shape), velocity
    )


@jit(static_argnames=("spec", "num_slices"))
def count_slices(
    cloud: PointCloud, spec: ImageSpec, *, num_slices: int
) -> tuple[Float[Array, "row column slice"], Float[Array, "row column slice"]]:
    """Return how many points fell into each pixel of each slice, and the least age.

    The age is in seconds, and 0 without a point. One cloud; `vmap` it.
    """
    check_one_cloud(cloud, "count_slices")
    pixel, distance, inside = _slice_pixels(cloud, spec, num_slices)
    shape = (*spec.shape, num_slices)
    size = math.prod(shape)
    pixel = jnp.where(inside, pixel, size)
    count = jnp.zeros(size, distance.dtype).at[pixel].add(1.0, mode="drop")
    age = jnp.zeros_like(distance) if cloud.age is None else cloud.age
    newest = _zero_if_empty(_scatter_min(age, pixel, size))
    return count.reshape(shape), newest.reshape(shape)


def _slice_pixels(cloud, spec, num_slices):
    """Pixel and slice of each point in one number, its range, and if it is in view."""
    # Without the barrier, XLA could compute a distance twice with a different last bit,
    # and the nearest point would not be found again.
    row, column, distance, inside = jax.lax.optimization_barrier(
        pixel_of(cloud.xyz, spec)
    )
    inside &= cloud.valid
    steps = jnp.where(inside, distance, 0.0) * (num_slices / spec.max_range_m)
    part = jnp.minimum(steps.astype(jnp.int32), num_slices - 1)
    return (row * spec.width + column) * num_slices + part, distance, inside


@jit(static_argnames="spec")
def unproject(image: Float[Array, "*batch row column"], spec: ImageSpec) -> PointCloud:
    """Return a point at the centre of each pixel; pixels of 0 metres are invalid."""
    if image.shape[-2:] != spec.shape:
        raise ValueError(
            f"image has shape {image.shape}, expected [..., *{spec.shape}]"
        )
    xyz = image[..., None] * jnp.asarray(pixel_directions(spec), image.dtype)
    leading = image.shape[:-2]
    return PointCloud(
        xyz=xyz.reshape(*leading, -1, 3), valid=(image > 0).reshape(*leading, -1)
    )


def image_cloud(image: RangeImage, spec: ImageSpec) -> PointCloud:
    """Return `unproject` of the ranges, whose points keep the image's confidence."""
    cloud = unproject(image.range_m, spec)
    if image.confidence is None:
        return cloud
    return cloud._replace(confidence=image.confidence.reshape(cloud.valid.shape))


def _scatter_min(values, index, size):
    """The smallest value of each of `size` pixels, or infinity; drops index `size`."""
    return jnp.full(size, jnp.inf, values.dtype).at[index].min(values, mode="drop")


def _zero_if_empty(values):
    return jnp.where(jnp.isfinite(values), values, 0.0)
