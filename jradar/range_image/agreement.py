"""Of several draws of one scene, what they agree on.

A draw is one of the images that the condition allows, and each is wrong elsewhere. A
score that counts points near the truth is highest, on average, for the range that most
draws come near, where enough of them do: neither their mean, which hangs between
surfaces, nor any one of them.
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
    """The range in metres that most of the draws come near, pixel by pixel.

    It is the mean of all draws within `tolerance_m` of the one that has the most of
    them there, the nearer one of two that have as many; 0, a miss, where these are less
    than `share` of all. Raises ValueError for a share or a tolerance that is none.
    """
    if not 0 < share <= 1:
        raise ValueError(f"share={share}, expected more than 0 and at most 1")
    if not tolerance_m > 0:
        raise ValueError(f"tolerance_m={tolerance_m}, expected metres, more than 0")
    hit = images > 0
    near = jnp.abs(images[:, None] - images[None]) <= tolerance_m
    near &= hit[:, None] & hit[None]
    count = near.sum(1)
    mean = jnp.where(near, images[None], 0.0).sum(1) / jnp.maximum(count, 1)
    most = count.max(0)
    nearest = jnp.where(count == most, mean, jnp.inf).min(0)
    return jnp.where((most > 0) & (most >= share * len(images)), nearest, 0.0)
