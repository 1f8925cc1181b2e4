"""Pixels near an echo that stands out of the noise, and those that are alone.

A network completes surfaces from little: some of what it draws lies far from all that
the radar measured. That may be the rest of a wall, or a wall that is not there, drawn
around a single strong echo. So what is alone must be surer to be kept.
"""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jradar.range_image.grid import ImageSpec
from jradar.range_image.projection import unproject
from jradar.types import PointCloud

LEAST_SNR = 4.0  # of a point that stands out, 6 dB
CELLS = 48  # in the largest range
REACH = 2  # cells, to a side


@functools.partial(jax.jit, static_argnames="spec")
def near_echo(
    range_m: Float[Array, "row column"], points: PointCloud, spec: ImageSpec
) -> Bool[Array, "row column"]:
    """Return which pixels lie near a radar point of 6 dB or more.

    Near is at most two cells away along each axis, of which the largest range has 48:
    about 0.5 m of 12. Without SNR all points stand out. Pixels without a range are not
    near anything. One image; `vmap` it.
    """
    half = CELLS + 1
    size = 2 * half

    def cells(xyz):
        index = jnp.floor(xyz * (CELLS / spec.max_range_m)).astype(jnp.int32) + half
        inside = ((index >= 0) & (index < size)).all(-1)
        return tuple(jnp.moveaxis(jnp.clip(index, 0, size - 1), -1, 0)), inside

    loud = (
        points.valid if points.snr is None else points.valid & (points.snr >= LEAST_SNR)
    )
    place, inside = cells(points.xyz)
    marked = jnp.zeros((size,) * 3, bool).at[place].max(loud & inside)
    for axis in range(3):
        window = [1, 1, 1]
        window[axis] = 2 * REACH + 1
        marked = jax.lax.reduce_window(
            marked, False, jax.lax.bitwise_or, tuple(window), (1, 1, 1), "SAME"
        )
    cloud = unproject(range_m, spec)
    place, inside = cells(cloud.xyz)
    near = marked[place] & inside & cloud.valid
    return near.reshape(range_m.shape)
