"""The kinds of models, each with its condition and the meaning of its answer.

view       range images of a frame's points, in three dimensions
polar      polar images of a frame's samples, in the plane of one row of antennas
columns    columns of a voxel map
"""

from jradar.model.grids.base import FrameGrid as FrameGrid, Grid as Grid
from jradar.model.grids.columns import ColumnGrid as ColumnGrid
from jradar.model.grids.polar import PolarGrid as PolarGrid
from jradar.model.grids.view import ViewGrid as ViewGrid

GRIDS: dict[str, type[Grid]] = {
    grid.kind: grid for grid in (ViewGrid, PolarGrid, ColumnGrid)
}
