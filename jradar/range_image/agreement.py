"""The range on which several draws of one scene agree, and how many do.

A draw is one of the images that the condition allows; each has errors in different
places. A score that counts points near the truth is highest, on average, for the range
near which most draws lie, if enough of them do. The mean of the draws would hang
between surfaces.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jradar.range_image.grid import ImageSpec
from jradar.range_image.projection import unproject
from jradar.types import PointCloud


class RangeImage(NamedTuple):
    """Ranges in metres, 0 for a miss, and how far to trust each of them, 0 to 1.

    The confidence is the probability that a surface is within a window around the
    range, as far as the method knows it; None for a method that does not.
    """

    range_m: Float[Array, "*batch row column"]
    confidence: Float[Array, "*batch row column"] | None = None


@functools.partial(jax.jit, static_argnames="tolerance_m")
def agreed_range(
    images: Float[Array, "draw row column"], *, tolerance_m: float = 0.2
) -> RangeImage:
    """Return the range near which most draws lie, and their share as confidence.

    The largest group of draws within `tolerance_m` of one of them gives its mean; of
    equally large groups, the one with the smaller mean. `confident` drops pixels of
    small groups. Raises ValueError for an impossible tolerance.
    """
    if not tolerance_m > 0:
        raise ValueError(f"{tolerance_m=}, expected more than 0 metres")
    hit = images > 0
    near = jnp.abs(images[:, None] - images[None]) <= tolerance_m
    near &= hit[:, None] & hit[None]
    count = near.sum(1)
    mean = jnp.where(near, images[None], 0.0).sum(1) / jnp.maximum(count, 1)
    most = count.max(0)
    nearest = jnp.where(count == most[None], mean, jnp.inf).min(0)
    share = most / len(images)
    return RangeImage(jnp.where(most > 0, nearest, 0.0), share.astype(images.dtype))


@jax.jit
def confident(image: RangeImage, least: float | Float[Array, ""]) -> RangeImage:
    """Return the image without pixels of less than the `least` confidence.

    An image without confidence stays as it is.
    """
    if image.confidence is None:
        return image
    keep = (image.range_m > 0) & (image.confidence >= least)
    range_m, confidence = (
        jnp.where(keep, value, 0.0) for value in (image.range_m, image.confidence)
    )
    return RangeImage(range_m, confidence)


@functools.partial(jax.jit, static_argnames="spec")
def image_cloud(image: RangeImage, spec: ImageSpec) -> PointCloud:
    """Return a point at the centre of each pixel, with the image's confidence."""
    cloud = unproject(image.range_m, spec)
    if image.confidence is None:
        return cloud
    leading = image.confidence.shape[:-2]
    return cloud._replace(confidence=image.confidence.reshape(*leading, -1))
