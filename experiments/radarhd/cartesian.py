"""RadarHD's own way to score an image: points on a Cartesian grid (its folder eval/).

    grid        256 rows, x (forward) from 0 to 10.8 m, and 512 columns, y (left) from
                -10.8 to 10.8 m, both evenly spaced with both ends
    cell        each polar pixel above 0 goes to the first grid value that is not below
                its x, and likewise for y; of several pixels in a cell the last counts
    threshold   cells above 1 of 255 are points, at the grid's values
    empty       an image without a point becomes the one point (0, 0, 0)
    CD          half of the sum of the two mean distances to the nearest point
    MHD         the larger of the two medians of these distances

RadarHD has no F-score; it is computed here on the same points. Its code stops at images
with exactly one occupied cell, which count as one point here.
"""

import functools

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from experiments.radarhd.pairs import LIDAR

FULL, THRESHOLD = 255, 1  # grey values of an occupied pixel, and of the darkest point
X_GRID = np.linspace(0, LIDAR.max_range_m, LIDAR.num_range)
Y_GRID = np.linspace(-LIDAR.max_range_m, LIDAR.max_range_m, LIDAR.num_azimuth)


def to_cartesian(
    image: UInt8[np.ndarray, "range azimuth"],
) -> UInt8[np.ndarray, "x y"]:
    """Return the grey values of a polar image on the Cartesian grid; on the host."""
    row, column = np.nonzero(image)
    cartesian = np.zeros((len(X_GRID), len(Y_GRID)), np.uint8)
    x, y = cells()
    # NumPy writes in order, so that the last of several pixels remains.
    cartesian[x[row, column], y[row, column]] = image[row, column]
    return cartesian


def cartesian_points(
    occupied: Bool[np.ndarray, "range azimuth"] | UInt8[np.ndarray, "range azimuth"],
) -> Float[np.ndarray, "point 3"]:
    """Return the points of a polar image, of grey values or of occupied pixels."""
    if occupied.shape != LIDAR.shape:
        raise ValueError(f"image has shape {occupied.shape}, expected {LIDAR.shape}")
    grey = np.where(occupied, FULL, 0) if occupied.dtype == bool else occupied
    points = to_points(to_cartesian(grey.astype(np.uint8)) > THRESHOLD)
    return points if len(points) else np.zeros((1, 3))


def to_points(cells: Bool[np.ndarray, "x y"]) -> Float[np.ndarray, "point 3"]:
    """Return the grid's values of the true cells, in the plane z = 0."""
    x, y = np.nonzero(cells)
    return np.stack([X_GRID[x], Y_GRID[y], np.zeros(len(x))], -1)


@functools.cache
def cells() -> tuple[
    Int[np.ndarray, "range azimuth"], Int[np.ndarray, "range azimuth"]
]:
    """Return the row and the column of the Cartesian cell of each polar pixel."""
    sine = np.sin(LIDAR.angles)
    distance = LIDAR.ranges[:, None]
    y, x = distance * sine, distance * np.sqrt(1 - sine**2)
    return tuple(
        np.searchsorted(grid, value) % len(grid)
        for grid, value in ((X_GRID, x), (Y_GRID, y))
    )
