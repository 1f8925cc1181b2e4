"""Completes a radar's map: the probability of each voxel, and the occupied voxels."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from jradar.errors import ModelError
from jradar.model import ColumnGrid, Model, draw
from jradar.model.grids.columns import (
    Voxels,
    condition_columns,
    middle_height,
    outline,
)

SIZES = (64, 96, 128, 160)  # of images of patches, in columns; each is compiled once
MARGIN = 16  # columns of an image beyond the radar's patch, both sides together
TILE, STRIDE = 96, 64  # of whole maps
LEAST = 0.03  # probability of voxels that are kept
RING = 0.1  # voxels; distances within one ring count as equal
SPREAD = 0.2  # of the logarithm of the number of voxels within the edge of a patch
MOST_TILES = 100_000  # 6 km x 6 km


class Occupied(NamedTuple):
    """Voxels by their numbers, likely ones first, and their probabilities."""

    voxels: Int[np.ndarray, "voxel 3"]
    probability: Float[np.ndarray, " voxel"]


def column_grid(model: Model) -> ColumnGrid:
    """Return the grid of a model of maps; ModelError for another model."""
    if not isinstance(model.spec.grid, ColumnGrid):
        raise ModelError(
            "this model sees single frames, expected one that completes maps, such as "
            "jradar-maps"
        )
    return model.spec.grid


def _probability(
    condition: Float[np.ndarray, "x y channel"], model: Model
) -> Float[np.ndarray, "x y height"]:
    """Return the probability of each voxel; every image draws with the same key."""
    return np.asarray(draw(jax.random.key(0), jnp.asarray(condition), model))


def enhance_patch(radar: Voxels, model: Model, *, least: float = LEAST) -> Occupied:
    """Return the LiDAR's voxels around the robot, from the radar's patch.

    Voxels of a probability of `least` or less are left out.
    """
    grid, around = column_grid(model), outline(radar)
    wanted = 2 * around.radius + MARGIN
    size = next((size for size in SIZES if size >= wanted), SIZES[-1])
    x, y = round(around.x) - size // 2, round(around.y) - size // 2
    origin = (x, y, middle_height(radar) - grid.heights // 2)
    image = condition_columns(radar, origin, (size, size), grid, observed=around)
    share = _probability(image, model)
    cells = np.argwhere(share > least)
    return likely_first(cells + np.asarray(origin), share[tuple(cells.T)])


def nearest(found: Occupied, x: float, y: float, count: int) -> Occupied:
    """Return the probability that a voxel is true and one of the `count` nearest.

    A patch of ColoRadar holds the `count` voxels nearest to the robot, which stands at
    `x` and `y` in voxels. So the patch ends at about the distance within which `count`
    true voxels are expected.
    """
    ring = (np.hypot(*(found.voxels[:, :2] - (x, y)).T) / RING).astype(int)
    in_ring = np.bincount(ring, found.probability)
    nearer = np.cumsum(in_ring) - in_ring / 2
    inside = (1 / (1 + (nearer / count) ** (1 / SPREAD)))[ring]
    return likely_first(found.voxels, found.probability * inside)


def enhance_map(radar: Voxels, model: Model, *, start_height: int = 0) -> Occupied:
    """Return the voxels of a whole map that the LiDAR would have found.

    Tiles overlap, and each counts most in its middle. Heights are above `start_height`,
    the number of the voxel in which the radar started. Raises ValueError for a map that
    has no voxels, or that is too large.
    """
    grid = column_grid(model)
    if not len(radar):
        raise ValueError("the radar's map has no voxels, expected one or more")
    low, high = radar.min(0), radar.max(0)
    counts = np.maximum(-(-(high - low + 1)[:2] // STRIDE), 1)
    if counts.prod() > MOST_TILES:
        size = (high - low) * grid.voxel_m
        raise ValueError(
            f"the map extends over {size[0]:,.0f} x {size[1]:,.0f} m, expected less "
            "than 6 km: do its poses jump?"
        )
    ramp = np.minimum(np.arange(TILE) + 1, np.arange(TILE)[::-1] + 1)
    taper = np.minimum.outer(ramp, ramp).astype(np.float32)
    border = (TILE - STRIDE) // 2
    weights = np.zeros(counts * STRIDE + 2 * border, np.float32)  # of each column
    found = _Sums()
    for row in range(counts[0]):
        for column in range(counts[1]):
            first = np.array([row, column]) * STRIDE
            x, y = (low[:2] + first - border).tolist()
            inside = (radar[:, :2] >= (x, y)).all(1) & (
                radar[:, :2] < (x + TILE, y + TILE)
            ).all(1)
            if not inside.any():
                continue
            near = radar[inside]
            z = middle_height(near) - grid.heights // 2
            relative = near - (0, 0, start_height)
            image = condition_columns(
                relative, (x, y, z - start_height), (TILE, TILE), grid, observed=None
            )
            share = _probability(image, model)
            cells = np.argwhere(share > LEAST)
            weights[first[0] : first[0] + TILE, first[1] : first[1] + TILE] += taper
            weighted = share[tuple(cells.T)] * taper[cells[:, 0], cells[:, 1]]
            found.add(cells + (x, y, z), weighted)
        found.settle(int(low[0]) + (row + 1) * STRIDE - border)  # the next row's first
    unique, total = found.result()
    columns = unique[:, :2] - low[:2] + border
    return likely_first(unique, total / weights[tuple(columns.T)])


class _Sums:
    """Sums of values by voxel, of which those before some x are settled early.

    A whole map's voxels at once would take several times the memory.
    """

    def __init__(self):
        self._settled = list[tuple[np.ndarray, np.ndarray]]()
        self._voxels, self._values = list[np.ndarray](), list[np.ndarray]()

    def add(self, voxels: np.ndarray, values: np.ndarray) -> None:
        """Add values, each to its voxel."""
        self._voxels.append(voxels.astype(np.int32))
        self._values.append(values)

    def settle(self, x: int | None = None) -> None:
        """Sum the voxels before x, which get no more values; by default all."""
        if not self._voxels:
            return
        voxels, values = np.concatenate(self._voxels), np.concatenate(self._values)
        done = np.ones(len(voxels), bool) if x is None else voxels[:, 0] < x
        self._voxels, self._values = [voxels[~done]], [values[~done]]
        unique, index = np.unique(voxels[done], axis=0, return_inverse=True)
        total = np.bincount(index.ravel(), values[done], minlength=len(unique))
        self._settled.append((unique, total))

    def result(self) -> tuple[np.ndarray, np.ndarray]:
        """Return each voxel once, in the order of x, y and z, and its sum."""
        self.settle()
        voxels, total = zip(*self._settled, strict=True)
        return np.concatenate(voxels), np.concatenate(total)


def likely_first(voxels: Voxels, probability: Float[np.ndarray, " voxel"]) -> Occupied:
    """Return the voxels in the order of their probability, in single precision.

    Numbers of 16 bits are sorted in linear time. So the lower halves are sorted first,
    then the upper ones.
    """
    probability = probability.astype(np.float32)
    bits = ~probability.view(np.uint32)
    order = np.argsort(bits.astype(np.uint16), kind="stable")
    order = order[np.argsort((bits >> 16).astype(np.uint16)[order], kind="stable")]
    return Occupied(voxels[order], probability[order])


def expected(found: Occupied) -> Occupied:
    """Return as many of the likeliest voxels as are expected to be true."""
    count = round(float(found.probability.sum()))
    return Occupied(*(values[:count] for values in found))


def best_count(probability: Float[np.ndarray, " voxel"], truth: float) -> int:
    """Return how many of the likeliest voxels have the largest expected F-score.

    With `truth` occupied voxels, of which the first k hold a part, the expected F-score
    is about 2 * sum(probability[:k]) / (k + truth).
    """
    if not len(probability):
        return 0
    hits = np.cumsum(probability)
    return int(np.argmax(2 * hits / (np.arange(len(hits)) + 1 + truth))) + 1
