"""The directions of a range image's pixels (Eq. 7).

    row 0       +----------------------+   highest elevation
      |         |                      |
      v         |                      |
    row H-1     +----------------------+   lowest elevation
              column 0  -->  column W-1
              right edge       left edge   (azimuth is positive to the left)

Rows and columns are equal steps of angle, as in the paper. Figures mirror the columns.

What is near depends on the view: 0.2 m where it ends at 12 m, 1 m where it ends at 60.
"""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jradar.compiled import jit

VIEW = ("azimuth", "elevation", "max_range_m")  # fields of a view
# arctan(t) = t (c0 + c1 t^2 + ... + c8 t^16) on 0 .. 1, a least-squares fit within 6e-9
# radians. XLA's arctan2 and arccos are slow on CPUs, because they are not vectorised.
_ARCTAN = (
    0.999999881,
    -0.333325982,
    0.199859068,
    -0.141612291,
    0.104989462,
    -0.0723485723,
    0.0397812203,
    -0.0144013558,
    0.00245672418,
)


@dataclasses.dataclass(frozen=True)
class ImageSpec:
    """Pixels and field of view; angles in radians, (lowest, highest)."""

    height: int
    width: int
    azimuth: tuple[float, float] = (-math.pi / 3, math.pi / 3)
    elevation: tuple[float, float] = (-math.pi / 9, math.pi / 9)
    max_range_m: float = 12.0

    def __post_init__(self):
        if self.height < 1 or self.width < 1:
            raise ValueError(
                f"image of {self.height} x {self.width} pixels, expected 1 or more"
            )
        for name, limit in (("azimuth", math.pi), ("elevation", math.pi / 2)):
            low, high = getattr(self, name)
            if not -limit <= low < high <= limit:
                raise ValueError(
                    f"{name} = ({low}, {high}), expected lowest < highest within "
                    f"+-{limit:.4f} radians"
                )
        if not 0 < self.max_range_m < math.inf:
            raise ValueError(
                f"max_range_m = {self.max_range_m}, expected more than 0 and finite"
            )

    @property
    def near_m(self) -> float:
        """The distance in metres within which a point is right: 0.2 of 12."""
        return self.max_range_m / 60

    @property
    def shape(self) -> tuple[int, int]:
        """Return the numbers of rows and columns."""
        return self.height, self.width


@jit(static_argnames="spec")
def pixel_of(
    xyz: Float[Array, "*batch 3"], spec: ImageSpec
) -> tuple[
    Int[Array, "*batch"],
    Int[Array, "*batch"],
    Float[Array, "*batch"],
    Bool[Array, "*batch"],
]:
    """Return row, column and range in metres of points, and True for points inside.

    Eq. 7. Intervals are half open: the highest azimuth and the lowest elevation are
    outside. So are NaN, the origin and points beyond the maximum range.
    """
    x, y, z = jnp.moveaxis(xyz, -1, 0)
    ground = x * x + y * y
    squared = ground + z * z
    safe = squared > 0  # keeps the gradient of the root finite at the origin
    distance = jnp.where(safe, jnp.sqrt(jnp.where(safe, squared, 1.0)), 0.0)
    azimuth = _arctan2(y, x)
    elevation = _arctan2(z, jnp.sqrt(ground))  # pi / 2 - arccos(z / distance)
    column = (azimuth - spec.azimuth[0]) * _per_radian(spec.width, spec.azimuth)
    row = (spec.elevation[1] - elevation) * _per_radian(spec.height, spec.elevation)
    inside = (column >= 0) & (column < spec.width) & (row >= 0) & (row < spec.height)
    inside &= safe & (distance <= spec.max_range_m)
    # NaN would become pixel 0, and an index of -1 the last pixel.
    row = jnp.where(inside, row, 0).astype(jnp.int32)
    column = jnp.where(inside, column, 0).astype(jnp.int32)
    return row, column, distance, inside


def pixel_directions(spec: ImageSpec) -> np.ndarray:
    """Return unit vectors through pixel centres, `[row, column, 3]`, on the host."""
    row, column = np.arange(spec.height) + 0.5, np.arange(spec.width) + 0.5
    azimuth = spec.azimuth[0] + column / _per_radian(spec.width, spec.azimuth)
    elevation = spec.elevation[1] - row / _per_radian(spec.height, spec.elevation)
    azimuth, elevation = np.broadcast_arrays(azimuth, elevation[:, None])
    ground = np.cos(elevation)
    vectors = [ground * np.cos(azimuth), ground * np.sin(azimuth), np.sin(elevation)]
    return np.stack(vectors, -1)


def _arctan2(y, x):
    """The angle of (x, y) within 3e-7 radians, without gradient; 0 at the origin."""
    x, y = jax.lax.stop_gradient((x, y))
    low, high = jnp.minimum(abs(x), abs(y)), jnp.maximum(abs(x), abs(y))
    ratio = low / jnp.where(high > 0, high, 1.0)
    series = jnp.full_like(ratio, _ARCTAN[-1])
    for coefficient in _ARCTAN[-2::-1]:
        series = series * ratio**2 + coefficient
    angle = ratio * series
    angle = jnp.where(abs(y) > abs(x), math.pi / 2 - angle, angle)
    angle = jnp.where(x < 0, math.pi - angle, angle)
    return jnp.where(y < 0, -angle, angle)


def _per_radian(pixels, interval):
    return pixels / (interval[1] - interval[0])
