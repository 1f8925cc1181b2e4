"""Training tiles: parts of patches and of whole maps, changed at random.

A tile lies somewhere in the LiDAR's patch. It is rotated by quarter turns, mirrored,
moved up or down, and loses some of its radar voxels. Now and then it is a part of the
whole map, because whole maps are enhanced, too.
"""

import dataclasses
import hashlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from jradar.data import Batch
from jradar.model import ColumnGrid
from jradar.model.grids.columns import (
    condition_columns,
    middle_height,
    outline,
    target_columns,
)
from jradar.recordings.coloradar.maps import MapRun


@dataclasses.dataclass(frozen=True)
class TileSpec:
    """How tiles are drawn: chances and extents of their changes."""

    whole: float = 0.15  # chance of a part of the whole map
    thin: float = 0.5  # chance to lose radar voxels, up to `most_lost` of them
    most_lost: float = 0.6
    most_raised: int = 3  # voxels up or down
    unknown_height: float = 0.3  # chance that the height is not given
    border_m: float = 1.2  # beyond the patch


class Tiles(Sequence):
    """The patches of several runs; `draw` makes a tile of one."""

    def __init__(self, runs: Sequence[MapRun], grid: ColumnGrid, tiles: TileSpec):
        """List the patches of all runs."""
        self.runs, self.grid, self.tiles = runs, grid, tiles
        self.places = [
            (i, k) for i, run in enumerate(runs) for k in range(len(run.radar_in_patch))
        ]

    @property
    def digest(self) -> str:
        """SHA-256 over the names and sizes of the runs."""
        return hashlib.sha256("\n".join(map(repr, self.runs)).encode()).hexdigest()

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, index):
        """Return the numbers of run and patch."""
        return self.places[index]

    def draw(self, place: tuple[int, int], rng: np.random.Generator) -> Batch:
        """Return condition and target of a tile of a patch."""
        run, grid, tiles = self.runs[place[0]], self.grid, self.tiles
        radar, patch = run.patch(place[1])
        around, truth = outline(radar), outline(patch)
        half = grid.tile // 2
        margin = tiles.border_m / grid.voxel_m
        reach = max(truth.radius - half, 0) + margin
        shift = rng.uniform(-reach, reach, 2)
        x, y = (round(v) for v in (truth.x + shift[0], truth.y + shift[1]))
        z = middle_height(radar) + int(
            rng.integers(-tiles.most_raised, tiles.most_raised + 1)
        )
        origin = (x - half, y - half, z - grid.heights // 2)
        size = (grid.tile, grid.tile)
        if rng.random() < tiles.whole:
            radar, around = run.radar, None
        if rng.random() < tiles.thin:
            kept = rng.random(len(radar)) >= rng.uniform(0, tiles.most_lost)
            radar = radar[kept]
        condition: Any = condition_columns(
            radar,
            origin,
            size,
            grid,
            observed=around,
            height_known=rng.random() >= tiles.unknown_height,
        )
        target: Any = target_columns(run.lidar, origin, size, grid)
        return symmetric(Batch(condition, target), int(rng.integers(8)))


def symmetric(pair: Batch, which: int) -> Batch:
    """Return one of the eight images that quarter turns and mirrors make."""

    def change(image) -> Any:
        image = np.rot90(image, which % 4)
        return np.ascontiguousarray(image.swapaxes(0, 1) if which >= 4 else image)

    return Batch(*map(change, pair))
