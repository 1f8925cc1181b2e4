"""Polar images in the plane of the radar, those of RadarHD (Prabhakara et al. 2023).

Row i stands for the i-th of evenly spaced ranges from 0 to 10.8 m, column j for the
j-th of evenly spaced azimuths from -90 to 90 degrees, both ends included.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jradar.options.suiting import MAX_RANGE_M

VIEW_M = 10.0  # ahead, and to either side


class PolarAxes(NamedTuple):
    """The range of each row of an image, and the azimuth of each column."""

    ranges: Float[np.ndarray, " range"]  # m
    angles: Float[np.ndarray, " azimuth"]  # rad, positive to the left

    @property
    def shape(self) -> tuple[int, int]:
        """The numbers of rows and columns."""
        return len(self.ranges), len(self.angles)

    @property
    def azimuth_step(self) -> float:
        """The angle between neighbouring columns, in radians."""
        return math.pi / (len(self.angles) - 1)

    @property
    def xyz(self) -> Float[np.ndarray, "range azimuth 3"]:
        """The point of each pixel, in the plane z = 0."""
        distance, azimuth = np.meshgrid(self.ranges, self.angles, indexing="ij")
        ahead, left = distance * np.cos(azimuth), distance * np.sin(azimuth)
        return np.stack([ahead, left, np.zeros_like(left)], -1)


def in_view(xyz: Any) -> Any:
    """Return which points `[*batch 3]` lie ahead and in RadarHD's view at any height.

    Points are an array of NumPy or of JAX.
    """
    x, y = xyz[..., 0], xyz[..., 1]
    ahead = (x > 0) & (x <= VIEW_M) & (abs(y) <= VIEW_M)
    return ahead & (x * x + y * y <= MAX_RANGE_M**2)


RADAR, LIDAR = (
    PolarAxes(
        np.linspace(0, MAX_RANGE_M, 256),
        np.linspace(-math.pi / 2, math.pi / 2, columns),
    )
    for columns in (64, 512)
)
