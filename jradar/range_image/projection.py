"""Scattering points to range images, nearest point first, and back.

An image holds metres, and 0 where no point fell. With slices, the range axis is cut
into equal parts, each projected by itself, so that far points are not hidden by near
ones (section IV-B). One cloud at a time; `vmap` it.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jradar.range_image.grid import ImageSpec, pixel_directions, pixel_of
from jradar.types import PointCloud


class SliceImages(NamedTuple):
    """The nearest point of each pixel and slice: its range and power, 0 where none."""

    range_m: Float[Array, "*batch row column slice"]
    power: Float[Array, "*batch row column slice"]


@functools.partial(jax.jit, static_argnames="spec")
def project(cloud: PointCloud, spec: ImageSpec) -> Float[Array, "row column"]:
    """Range image of a cloud, in metres; 0 where no point fell."""
    return project_slices(cloud, spec, num_slices=1).range_m[..., 0]


@functools.partial(jax.jit, static_argnames=("spec", "num_slices"))
def project_slices(
    cloud: PointCloud, spec: ImageSpec, *, num_slices: int
) -> SliceImages:
    """Range image of each of `num_slices` equal parts of the range axis.

    A cloud that measured no power has power 1. Where two points of a pixel are equally
    near, the stronger one's power is kept.
    """
    row, column, distance, inside = pixel_of(cloud.xyz, spec)
    inside &= cloud.valid
    part = (distance * (num_slices / spec.max_range_m)).astype(jnp.int32)
    pixel = (row, column, jnp.clip(part, 0, num_slices - 1))
    empty = jnp.zeros((*spec.shape, num_slices), distance.dtype)
    nearest = (empty + jnp.inf).at[pixel].min(jnp.where(inside, distance, jnp.inf))

    power = jnp.ones_like(distance) if cloud.power is None else cloud.power
    is_nearest = inside & (distance == nearest[pixel])
    power = empty.at[pixel].max(jnp.where(is_nearest, power, 0.0))
    return SliceImages(jnp.where(jnp.isfinite(nearest), nearest, 0.0), power)


@functools.partial(jax.jit, static_argnames="spec")
def unproject(image: Float[Array, "*batch row column"], spec: ImageSpec) -> PointCloud:
    """Cloud of one point per pixel, at its centre; pixels of 0 metres are invalid."""
    if image.shape[-2:] != spec.shape:
        raise ValueError(
            f"image has shape {image.shape}, expected [..., *{spec.shape}]"
        )
    xyz = image[..., None] * jnp.asarray(pixel_directions(spec), image.dtype)
    leading = image.shape[:-2]
    return PointCloud(
        xyz=xyz.reshape(*leading, -1, 3), valid=(image > 0).reshape(*leading, -1)
    )
