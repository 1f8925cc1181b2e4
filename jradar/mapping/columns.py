"""Voxel maps as images: a column of voxels is a pixel, its heights are the channels.

    condition [x, y, channel]   radar voxels of each height | observed | height | known
    target    [x, y, channel]   LiDAR voxels of each height | inside

`observed` is 1 in the cylinder that radar voxels were given for. `height` is that of
the image above the origin of the map, if `known` is 1. `inside` marks the columns of
the LiDAR's patch. Radar voxels below or above the image count at its border.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int

EXTRA = 3  # channels of a condition beyond the heights
HEIGHT_SCALE_M = 4.0

Voxels = Int[np.ndarray, "voxel 3"]


@dataclasses.dataclass(frozen=True)
class MapSpec:
    """The size of voxels, and how many of them an image holds."""

    voxel_m: float = 0.15
    heights: int = 64
    tile: int = 64  # columns of a side, in training

    def metres(self, voxels: "Voxels") -> Float[np.ndarray, "voxel 3"]:
        """Return the middles of voxels."""
        return (voxels + 0.5) * self.voxel_m


class Circle(NamedTuple):
    """The horizontal outline of a patch, in voxels."""

    x: float
    y: float
    radius: float


def outline(voxels: Voxels) -> Circle:
    """Return the circle around the middle of the voxels' extent."""
    flat = voxels[:, :2].astype(float)
    x, y = (flat.min(0) + flat.max(0)) / 2
    return Circle(x, y, float(np.hypot(*(flat - (x, y)).T).max()))


def middle_height(radar: Voxels) -> int:
    """Return the number of the height in the middle of an image of these voxels."""
    return round(float(radar[:, 2].mean()))


def condition_columns(
    radar: Voxels,
    origin: tuple[int, int, int],
    size: tuple[int, int],
    spec: MapSpec,
    *,
    observed: Circle | None,
    height_known: bool = True,
) -> Float32[np.ndarray, "x y channel"]:
    """Return the condition whose first voxel is `origin`.

    Without `observed`, radar voxels were given for the whole image.
    """
    image = np.zeros((*size, spec.heights + EXTRA), np.float32)
    _fill(image, radar, origin, spec.heights, clip=True)
    image[..., -3] = 1 if observed is None else _within(observed, origin, size)
    if height_known:
        middle = origin[2] + spec.heights // 2
        image[..., -2] = middle * spec.voxel_m / HEIGHT_SCALE_M
        image[..., -1] = 1
    return image


def target_columns(
    lidar: Voxels,
    patch: Voxels | None,
    origin: tuple[int, int, int],
    size: tuple[int, int],
    spec: MapSpec,
) -> Float32[np.ndarray, "x y channel"]:
    """Return the target whose first voxel is `origin`, of a map and a patch of it.

    Without a patch, all columns are inside.
    """
    image = np.zeros((*size, spec.heights + 1), np.float32)
    _fill(image, lidar, origin, spec.heights)
    if patch is None:
        image[..., -1] = 1
        return image
    in_patch = np.zeros((*size, spec.heights), bool)
    _fill(in_patch, patch, origin, spec.heights)
    occupied = image[..., :-1].any(-1)
    inside = _within(outline(patch), origin, size)
    image[..., -1] = np.where(occupied, in_patch.any(-1), inside)
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
    """Which columns of an image are in a circle."""
    x = np.arange(size[0])[:, None] + origin[0] - circle.x
    y = np.arange(size[1]) + origin[1] - circle.y
    return np.hypot(x, y) <= circle.radius + 0.5
