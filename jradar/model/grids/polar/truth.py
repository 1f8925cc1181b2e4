"""What a LiDAR sees in the plane of the radar, as in RadarHD (Prabhakara et al. 2023).

    scan about the radar -> true_points -> lidar_image        256 ranges x 512 azimuths

These are host functions.
"""

import numpy as np
from jaxtyping import Bool, Float

from jradar.model.grids.polar.axes import LIDAR, in_view

HALF_HEIGHT_M = 0.3  # of the points, above and below the radar


def true_points(
    xyz: Float[np.ndarray, "point 3"],
) -> Float[np.ndarray, "seen 3"]:
    """Return the points of a scan about the radar that RadarHD's LiDAR images show.

    They are at most 0.3 m above or below the radar; see `in_plane`.
    """
    return in_plane(xyz[abs(xyz[:, 2]) <= HALF_HEIGHT_M])


def in_plane(
    xyz: Float[np.ndarray, "point 3"],
) -> Float[np.ndarray, "seen 3"]:
    """Return the points ahead that are in RadarHD's view, at height 0."""
    return xyz[in_view(xyz)] * [1, 1, 0]


def lidar_image(
    xyz: Float[np.ndarray, "point 3"],
) -> Bool[np.ndarray, "range azimuth"]:
    """Return the occupancy of a scan about the radar, formed as RadarHD forms it.

    A point goes to the pixel at or beyond its range, and at or to the left of its
    azimuth.
    """
    x, y, _ = true_points(xyz).T
    row = np.searchsorted(LIDAR.ranges, np.hypot(x, y))
    column = np.searchsorted(LIDAR.angles, np.arctan2(y, x))
    occupied = np.zeros(LIDAR.shape, bool)
    occupied[row, column] = True
    return occupied
