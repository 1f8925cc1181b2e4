"""The grid of voxel maps: columns of a radar's map in, a LiDAR's columns out.

radar voxels --condition_columns--> condition [x, y, channel]
--network--> probability [x, y, height]
"""

import dataclasses
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from jradar.model.grids.base import Grid
from jradar.model.grids.columns.answers import METHODS
from jradar.model.grids.columns.images import EXTRA, Voxels
from jradar.range_image import frequency


@dataclasses.dataclass(frozen=True)
class ColumnGrid(Grid):
    """The size of voxels, and how many of them an image holds."""

    kind: ClassVar[str] = "columns"
    methods = METHODS
    of_frames: ClassVar[bool] = False

    voxel_m: float = 0.15
    heights: int = 64
    tile: int = 64  # columns of a side, in training

    @property
    def image_shape(self) -> tuple[int, int, int]:
        """The voxels of a tile, [x, y, height]."""
        return self.tile, self.tile, self.heights

    @property
    def condition_shape(self) -> tuple[int, int, int]:
        """The radar's voxels of a tile, and what is known of them."""
        return self.tile, self.tile, self.heights + EXTRA

    def check(self, shape):
        """Raise ValueError for another number of channels; any size is answered."""
        if len(shape) != 3 or shape[-1] != self.heights + EXTRA:
            raise ValueError(
                f"condition has shape {shape}, the model needs [x, y, channel] with "
                f"{self.heights + EXTRA} channels: one condition, or another model's?"
            )

    def calibrated(self, image, tables):
        """Return how often voxels of such a probability are occupied."""
        return frequency(image, tables.confidence)

    def kept(self, image, least, tables, condition):
        """Return all probabilities: a map keeps its likely voxels as a whole."""
        return image

    def metres(self, voxels: Voxels) -> Float[np.ndarray, "voxel 3"]:
        """Return the middles of voxels."""
        return (voxels + 0.5) * self.voxel_m
