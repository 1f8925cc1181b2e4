"""Columns of voxels: the grid of models that complete a radar's map."""

from jradar.model.grids.columns.answers import (
    METHODS as METHODS,
    NOISE as NOISE,
)
from jradar.model.grids.columns.grid import ColumnGrid as ColumnGrid
from jradar.model.grids.columns.images import (
    Voxels as Voxels,
    condition_columns as condition_columns,
    middle_height as middle_height,
    outline as outline,
    target_columns as target_columns,
)
