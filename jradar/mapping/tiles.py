"""Training tiles: parts of patches and of whole maps, changed at random.

A tile lies somewhere in the LiDAR's patch, is rotated, mirrored, moved up or down, and
loses some of its radar voxels. Now and then it is a part of the whole map, since whole
maps are enhanced, too.
"""

import dataclasses
import hashlib
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from jradar.mapping.columns import (
    MapSpec,
    condition_columns,
    middle_height,
    outline,
    target_columns,
)
from jradar.recordings.coloradar.maps import MapRun
from jradar.training import Batch


@dataclasses.dataclass(frozen=True)
class TileSpec:
    """How tiles are drawn: chances and extents of their changes."""

    whole: float = 0.15  # chance of a part of the whole map
    rotated: float = (
        0.5  # chance of a rotation by any angle, not by quarter turns alone
    )
    thin: float = 0.5  # chance to lose radar voxels, up to `most_lost` of them
    most_lost: float = 0.6
    most_raised: int = 3  # voxels up or down
    unknown_height: float = 0.3  # chance that the height is not given
    border_m: float = 1.2  # beyond the patch


class Tiles(Sequence):
    """The patches of several runs; `draw` makes a tile of one."""

    def __init__(self, runs: Sequence[MapRun], spec: MapSpec, tiles: TileSpec):
        """List the patches of all runs."""
        self.runs, self.spec, self.tiles = runs, spec, tiles
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
        run, spec, tiles = self.runs[place[0]], self.spec, self.tiles
        radar, patch = run.patch(place[1])
        around, truth = outline(radar), outline(patch)
        oblique = rng.random() < tiles.rotated
        side = math.ceil(math.sqrt(2) * spec.tile) if oblique else spec.tile
        half, middle = spec.tile // 2, side // 2
        margin = tiles.border_m / spec.voxel_m
        reach = max(truth.radius - half, 0) + margin
        shift = rng.uniform(-reach, reach, 2)
        x, y = (round(v) for v in (truth.x + shift[0], truth.y + shift[1]))
        z = middle_height(radar) + int(
            rng.integers(-tiles.most_raised, tiles.most_raised + 1)
        )
        origin = (x - middle, y - middle, z - spec.heights // 2)
        size = (side, side)
        whole = rng.random() < tiles.whole
        if whole:
            radar, around, patch = run.radar, None, None
        if rng.random() < tiles.thin:
            kept = rng.random(len(radar)) >= rng.uniform(0, tiles.most_lost)
            radar = radar[kept]
        condition: Any = condition_columns(
            radar,
            origin,
            size,
            spec,
            observed=around,
            height_known=rng.random() >= tiles.unknown_height,
        )
        target: Any = target_columns(run.lidar, patch, origin, size, spec)
        pair = symmetric(Batch(condition, target), int(rng.integers(8)))
        if not oblique:
            return pair
        angle = rng.uniform(-np.pi / 4, np.pi / 4)
        return Batch(*(rotated(image, angle, spec.tile) for image in pair))


def symmetric(pair: Batch, which: int) -> Batch:
    """Return one of the eight images that quarter turns and mirrors make."""

    def change(image) -> Any:
        image = np.rot90(image, which % 4)
        return np.ascontiguousarray(image.swapaxes(0, 1) if which >= 4 else image)

    return Batch(*map(change, pair))


def rotated(image: Any, angle: float, side: int) -> Any:
    """Return the middle of an image of columns, rotated by `angle` in radians.

    Each column is the nearest one of `image`, which has to be wide enough.
    """
    steps = np.arange(side) - (side - 1) / 2
    x, y = np.meshgrid(steps, steps, indexing="ij")
    cos, sin = np.cos(angle), np.sin(angle)
    middle = (image.shape[0] - 1) / 2
    places = np.stack([cos * x + sin * y, cos * y - sin * x]) + middle
    return image[tuple(np.rint(places).astype(int))]
