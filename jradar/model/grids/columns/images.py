"""Voxel maps as images: a column of voxels is a pixel, its heights are the channels.

    condition [x, y, channel]   radar voxels of each height | observed | height | known
    target    [x, y, height]    LiDAR voxels

`observed` is 1 in the cylinder that radar voxels were given for. `height` is that of
the image above the origin of the map, if `known` is 1. Radar voxels below or above the
image count at its border.
"""

import itertools
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float32, Int

EXTRA = 3  # channels of a condition beyond the heights
HEIGHT_SCALE_M = 4.0
DIRECTIONS = 32  # in which the voxels of an outline are looked for
TINY = 1e-6  # voxels^2

Voxels = Int[np.ndarray, "voxel 3"]


@runtime_checkable
class Heights(Protocol):
    """How many voxels an image holds, and their size; `ColumnGrid` is one."""

    @property
    def voxel_m(self) -> float:
        """The side of a voxel."""
        ...

    @property
    def heights(self) -> int:
        """The number of voxels in a column."""
        ...


class Circle(NamedTuple):
    """The horizontal outline of a patch, in voxels; the robot is in the middle."""

    x: float
    y: float
    radius: float


def outline(voxels: Voxels) -> Circle:
    """Return the smallest circle around the columns of voxels.

    It passes through three columns, or two on its diameter. The columns that are the
    farthest in one of DIRECTIONS are tried.
    """
    flat = voxels[:, :2].astype(float)
    angle = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    farthest = np.argmax(flat @ [np.cos(angle), np.sin(angle)], axis=0)
    rim = np.unique(flat[farthest], axis=0)
    middles = np.concatenate([[(a + b) / 2 for a in rim for b in rim], _middles(rim)])
    away = np.linalg.norm(middles[:, None] - rim, axis=-1).max(1)
    x, y = middles[np.argmin(away)]
    return Circle(float(x), float(y), float(np.hypot(*(flat - (x, y)).T).max()))


def _middles(points):
    """Return the middles of the circles through any three points not on a line."""
    triples = [*itertools.combinations(points, 3)]
    first, *others = np.array(triples).reshape(-1, 3, 2).swapaxes(0, 1)
    # With the first point at the origin, 2 p m = |p|^2 for the middle m and others p.
    matrix = 2 * np.stack([other - first for other in others], 1)
    kept = np.abs(np.linalg.det(matrix)) > TINY
    squares = ((matrix[kept] / 2) ** 2).sum(-1)
    return first[kept] + np.linalg.solve(matrix[kept], squares[..., None])[..., 0]


def middle_height(radar: Voxels) -> int:
    """Return the number of the height in the middle of an image of these voxels."""
    return round(float(radar[:, 2].mean()))


def condition_columns(
    radar: Voxels,
    origin: tuple[int, int, int],
    size: tuple[int, int],
    grid: Heights,
    *,
    observed: Circle | None,
    height_known: bool = True,
) -> Float32[np.ndarray, "x y channel"]:
    """Return the condition whose first voxel is `origin`.

    Without `observed`, radar voxels were given for the whole image.
    """
    image = np.zeros((*size, grid.heights + EXTRA), np.float32)
    _fill(image, radar, origin, grid.heights, clip=True)
    image[..., -3] = 1 if observed is None else _within(observed, origin, size)
    if height_known:
        middle = origin[2] + grid.heights // 2
        image[..., -2] = middle * grid.voxel_m / HEIGHT_SCALE_M
        image[..., -1] = 1
    return image


def target_columns(
    lidar: Voxels,
    origin: tuple[int, int, int],
    size: tuple[int, int],
    grid: Heights,
) -> Float32[np.ndarray, "x y height"]:
    """Return the target whose first voxel is `origin`."""
    image = np.zeros((*size, grid.heights), np.float32)
    _fill(image, lidar, origin, grid.heights)
    return image


def _fill(image, voxels, origin, heights, *, clip=False):
    """Set the voxels that an image holds to 1."""
    x, y, z = (voxels - np.asarray(origin)).T
    if clip:
        z = np.clip(z, 0, heights - 1)
    kept = (x >= 0) & (x < image.shape[0]) & (y >= 0) & (y < image.shape[1])
    kept &= (z >= 0) & (z < heights)
    image[x[kept], y[kept], z[kept]] = 1


def _within(circle, origin, size):
    """Return which columns of an image are in a circle."""
    x = np.arange(size[0])[:, None] + origin[0] - circle.x
    y = np.arange(size[1]) + origin[1] - circle.y
    return np.hypot(x, y) <= circle.radius + 0.5
