"""The radial velocity of a dense cloud's points: that of the nearest radar point.

Radar points are sparse. A pixel of the dense image takes the velocity of a radar point
at nearly its range, in its own coarse pixel or in one nearby; the nearest in angle
wins. Elsewhere the radar measured no velocity.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jradar.compiled import jit
from jradar.range_image.grid import ImageSpec
from jradar.range_image.projection import project_slices
from jradar.types import PointCloud

REACH = 2  # coarse pixels, up, down and to the sides
TOLERANCE_M = 0.4  # between a pixel's range and the radar point's


@jit(static_argnames=("coarse", "num_slices"))
def velocity_image(
    range_m: Float[Array, "row column"],
    cloud: PointCloud,
    coarse: ImageSpec,
    *,
    num_slices: int,
) -> Float[Array, "row column"]:
    """Return each pixel's velocity (m/s), NaN where the radar saw nothing near.

    `range_m` is an image of the same field of view as `coarse`, in metres, 0 for a
    miss. One image; `vmap` it. Raises ValueError for a cloud without velocities, or an
    image whose size is not a multiple of the coarse one.
    """
    if cloud.velocity is None:
        raise ValueError("the cloud has no velocity: expected one of a radar")
    rows, columns = range_m.shape
    if rows % coarse.height or columns % coarse.width:
        raise ValueError(
            f"image of {rows} x {columns} pixels, expected a multiple of "
            f"{coarse.height} x {coarse.width}"
        )
    slices = project_slices(cloud, coarse, num_slices=num_slices)
    assert slices.velocity is not None
    known = jnp.stack([slices.range_m, slices.velocity], -1)
    known = _spread(known).repeat(rows // coarse.height, 0)
    known = known.repeat(columns // coarse.width, 1)
    ranges, velocities = known[..., 0], known[..., 1]
    away = jnp.where(ranges > 0, jnp.abs(ranges - range_m[..., None]), jnp.inf)
    nearest = away.argmin(-1, keepdims=True)
    velocity = jnp.take_along_axis(velocities, nearest, -1)[..., 0]
    found = (away.min(-1) <= TOLERANCE_M) & (range_m > 0)
    return jnp.where(found, velocity, jnp.nan)


def _spread(known):
    """Range and velocity [row, column, slice, 2], gaps filled from near pixels."""
    rows, columns = known.shape[:2]
    margin = [(REACH, REACH)] * 2 + [(0, 0)] * 2
    padded = jnp.pad(known, margin)
    steps = range(-REACH, REACH + 1)
    moves = sorted(
        ((i, j) for i in steps for j in steps), key=lambda m: m[0] ** 2 + m[1] ** 2
    )
    filled = known
    for down, right in moves[1:]:
        top, left = REACH + down, REACH + right
        near = padded[top : top + rows, left : left + columns]
        filled = jnp.where(filled[..., :1] > 0, filled, near)
    return filled
