"""Floor and ceiling, by Patchwork++ (Lee et al. 2022), on the host.

Patchwork++ fits small planes to the patches of a polar grid. It needs the sensor's
height, and accepts any level patch below the sensor, even a table. Here each scan is
labelled independently:

1. the floor is the level plane with the largest area (RANSAC over flat cells of
   0.25 m); it gives the sensor's height and tilt;
2. the cloud is levelled and labelled by a new Patchwork++;
3. points more than 0.2 m plus 5 % of the distance above the floor are removed from the
   mask; points within 0.06 m of it are added, because patches fit badly at the feet of
   walls.

The result depends on the scan only, not on the order of frames, workers or shards. The
ceiling is the floor of the cloud upside down.
"""

import contextlib
import math
import os
import threading
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jradar.errors import optional
from jradar.lidar.align import returns, transform

CELL_M, FLAT_M = 0.25, 0.1  # the heights in a flat cell differ by less than FLAT_M
MIN_AREA_M2 = 1.5  # of a floor
MIN_SHARE = 0.35  # of a floor among the flat cells on that side of the sensor
MIN_HEIGHT_M = 0.25  # rings of one beam on far walls look like a floor at height 0
NEAR_PLANE_M = 0.06
MAX_TILT = math.radians(20)
TRIALS, VOTERS = 200, 500  # planes that are tried, cells that vote
STEP_M, SLOPE = 0.2, 0.05  # uneven ground above the plane: metres, and per metre
MIN_POINTS = 10  # of a patch: Patchwork++ ignores smaller ones
_STDOUT = threading.Lock()


class Plane(NamedTuple):
    """A level surface: upward unit normal, and the height of the sensor above it."""

    normal: Float[np.ndarray, "3"]
    height_m: float


def ground_mask(
    xyz: Float[np.ndarray, "point 3"],
    *,
    among: Bool[np.ndarray, " point"] | None = None,
    sensor_height_m: float | None = None,
    max_range_m: float = 12.0,
    thickness_m: float = 0.08,
) -> Bool[np.ndarray, " point"]:
    """Return which points belong to the floor, on the host.

    They lie at most `thickness_m` above its local plane. Only points in `among` are
    labelled; all points within `max_range_m` help to find the floor. For a level sensor
    of known height, `sensor_height_m` replaces the search. If no floor is found, the
    mask is empty.
    """
    real = _within(xyz, max_range_m)
    ground = np.zeros(len(xyz), bool)
    if sensor_height_m is None:
        plane, near = floor_plane(xyz, max_range_m=max_range_m), NEAR_PLANE_M
    else:
        plane, near = Plane(np.array([0.0, 0.0, 1.0]), sensor_height_m), 0.0
    chosen = np.flatnonzero(real if among is None else real & among)
    if plane is None or len(chosen) < MIN_POINTS:
        return ground
    rotation = np.eye(4)
    rotation[:3, :3] = _levelling(plane.normal)
    level = transform(rotation, xyz[chosen].astype(np.float32))
    found = _patchwork(level, plane.height_m, max_range_m, thickness_m)
    height = level[:, 2] + plane.height_m
    ground[chosen[found]] = True
    ground[chosen[height > STEP_M + SLOPE * np.hypot(*level.T[:2])]] = False
    ground[chosen[np.abs(height) < near]] = True
    return ground


def ceiling_mask(
    xyz: Float[np.ndarray, "point 3"],
    *,
    among: Bool[np.ndarray, " point"] | None = None,
    max_range_m: float = 12.0,
    thickness_m: float = 0.08,
) -> Bool[np.ndarray, " point"]:
    """Return which points belong to the ceiling: `ground_mask` upside down."""
    return ground_mask(
        xyz * np.array([1, 1, -1], xyz.dtype),
        among=among,
        max_range_m=max_range_m,
        thickness_m=thickness_m,
    )


def floor_plane(
    xyz: Float[np.ndarray, "point 3"], *, max_range_m: float = 12.0
) -> Plane | None:
    """Return the level plane with the largest area below the sensor, on the host.

    RANSAC over flat cells, always with the same random draws. None if the plane
    has less than 1.5 square metres or 35 % of the flat cells, tilts by more than 20
    degrees, or is less than 0.25 m below the sensor.
    """
    below = _within(xyz, max_range_m) & (xyz[:, 2] < -MIN_HEIGHT_M)
    cells = _flat_cells(xyz[below], max_range_m)
    enough = max(MIN_AREA_M2 / CELL_M**2, MIN_SHARE * len(cells))
    if len(cells) < enough:
        return None
    near = _largest_plane(cells)
    if near.sum() < enough:
        return None
    middle = cells[near].mean(0)
    _, _, axes = np.linalg.svd(cells[near] - middle, full_matrices=False)
    normal = axes[2] * np.sign(axes[2, 2])
    height = -float(normal @ middle)
    if normal[2] < math.cos(MAX_TILT) or height < MIN_HEIGHT_M:
        return None
    return Plane(normal, height)


def _largest_plane(cells):
    """Mask of the cells near the best of many level planes through three cells."""
    draws = np.random.default_rng(0).integers(len(cells), size=(TRIALS, 3))
    first, second, third = np.moveaxis(cells[draws], 1, 0)
    normals = np.cross(second - first, third - first)
    length = np.linalg.norm(normals, axis=-1)
    level = np.abs(normals[:, 2]) > math.cos(MAX_TILT) * length
    if not level.any():
        return np.zeros(len(cells), bool)
    normals, first = normals[level] / length[level, None], first[level]
    x, y, z = cells[:: len(cells) // VOTERS + 1].T
    a, b, c, offset = np.c_[normals, (normals * first).sum(-1)].T[:, :, None]
    votes = (np.abs(a * x + b * y + c * z - offset) < NEAR_PLANE_M).sum(-1)
    best = votes.argmax()
    return np.abs((cells - first[best]) @ normals[best]) < NEAR_PLANE_M


def _within(xyz, max_range_m):
    """Echoes inside an upright cylinder."""
    return returns(xyz) & (np.hypot(xyz[:, 0], xyz[:, 1]) <= max_range_m)


def _flat_cells(xyz, max_range_m):
    """Mean points `[cell, 3]` of flat cells with two points or more."""
    half = math.ceil(max_range_m / CELL_M)
    column, row = np.floor(xyz[:, :2] / CELL_M).astype(np.int64).T + half
    key, size = column * (2 * half + 1) + row, (2 * half + 1) ** 2
    count = np.bincount(key, minlength=size)
    low, high = np.full((2, size), [[np.inf], [-np.inf]], xyz.dtype)
    np.minimum.at(low, key, xyz[:, 2])
    np.maximum.at(high, key, xyz[:, 2])
    flat = (count >= 2) & (high - low < FLAT_M)
    sums = [np.bincount(key, axis, minlength=size)[flat] for axis in xyz.T]
    return (np.stack(sums, -1) / count[flat][:, None]).astype(np.float32)


def _levelling(normal):
    """Shortest rotation that takes the normal to (0, 0, 1)."""
    x, y, z = normal
    return np.array(
        [
            [1 - x * x / (1 + z), -x * y / (1 + z), -x],
            [-x * y / (1 + z), 1 - y * y / (1 + z), -y],
            [x, y, z],
        ]
    )


def _patchwork(xyz, height_m, max_range_m, thickness_m):
    """Indices of ground points by a new Patchwork++ without memory of other scans."""
    need = "floor and ceiling need pypatchworkpp"
    pypatchworkpp = optional("pypatchworkpp", need=need, extra="data")
    parameters = pypatchworkpp.Parameters()
    parameters.enable_RNR = False  # expects intensities on one maker's scale
    parameters.sensor_height = height_m
    parameters.min_range, parameters.max_range = 0.1, max_range_m
    parameters.num_min_pts = MIN_POINTS
    parameters.th_dist = thickness_m
    parameters.elevation_thr = [STEP_M - height_m] * 4
    with _stdout_to_nowhere():
        estimator = pypatchworkpp.patchworkpp(parameters)
        estimator.estimateGround(xyz)
    return np.asarray(estimator.getGroundIndices(), int).ravel()


@contextlib.contextmanager
def _stdout_to_nowhere() -> Iterator[None]:
    """Redirect file descriptor 1, to which the library prints a greeting."""
    with _STDOUT:
        kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, 1)
            yield
        finally:
            os.dup2(kept, 1)
            os.close(kept)
            os.close(nowhere)
