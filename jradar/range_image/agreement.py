"""The range on which several draws of one scene agree.

A draw is one of the images that the condition allows; each has errors in different
places. A score that counts points near the truth is highest, on average, for the range
near which most draws lie, if enough of them do. The mean of the draws would hang
between surfaces.
"""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


@functools.partial(jax.jit, static_argnames=("share", "tolerance_m"))
def agreed_range(
    images: Float[Array, "draw row column"],
    *,
    share: float = 0.375,
    tolerance_m: float = 0.2,
) -> Float[Array, "row column"]:
    """Return the range in metres near which most draws lie, for each pixel.

    The largest group of draws within `tolerance_m` of one of them gives its mean; of
    equally large groups, the one with the smaller mean. Pixels whose group is smaller
    than `share` of all draws are misses, 0. Raises ValueError for an impossible share
    or tolerance.
    """
    if not 0 < share <= 1:
        raise ValueError(f"{share=}, expected more than 0 and at most 1")
    if not tolerance_m > 0:
        raise ValueError(f"{tolerance_m=}, expected more than 0 metres")
    hit = images > 0
    near = jnp.abs(images[:, None] - images[None]) <= tolerance_m
    near &= hit[:, None] & hit[None]
    count = near.sum(1)
    mean = jnp.where(near, images[None], 0.0).sum(1) / jnp.maximum(count, 1)
    most = count.max(0)
    nearest = jnp.where(count == most[None], mean, jnp.inf).min(0)
    return jnp.where((most > 0) & (most >= share * len(images)), nearest, 0.0)
