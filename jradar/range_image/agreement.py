"""The range on which several draws of one scene agree, and how many do.

A draw is one of the images that the condition allows; each has errors in different
places. A score that counts points near the truth is highest, on average, for the range
near which most draws lie, if enough of them do. The mean of the draws would hang
between surfaces.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jradar.compiled import jit
from jradar.range_image.projection import RangeImage

TOLERANCE_M = 0.2  # of draws from the one that they agree with


@jit
def agreed_range(images: Float[Array, "draw row column"]) -> RangeImage:
    """Return the range near which most draws lie, and their share as confidence.

    The largest group of draws within 0.2 m of one of them gives its mean; of equally
    large groups, the one with the smaller mean. `confident` drops pixels of small
    groups.
    """
    hit = images > 0
    near = jnp.abs(images[:, None] - images[None]) <= TOLERANCE_M
    near &= hit[:, None] & hit[None]
    count = near.sum(1)
    mean = jnp.where(near, images[None], 0.0).sum(1) / jnp.maximum(count, 1)
    most = count.max(0)
    nearest = jnp.where(count == most[None], mean, jnp.inf).min(0)
    share = most / len(images)
    return RangeImage(jnp.where(most > 0, nearest, 0.0), share.astype(images.dtype))


@jit
def confident(
    image: RangeImage, least: float | Float[Array | np.ndarray, "..."]
) -> RangeImage:
    """Return the image without pixels of less than the `least` confidence.

    `least` is one number, or one for each pixel. An image without confidence stays as
    it is.
    """
    if image.confidence is None:
        return image
    keep = (image.range_m > 0) & (image.confidence >= least)
    range_m, confidence = (
        jnp.where(keep, value, 0.0) for value in (image.range_m, image.confidence)
    )
    return RangeImage(range_m, confidence)
