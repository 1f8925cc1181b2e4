"""Range images: the grid of the paper."""

from jradar.model.grids.view.answers import likeliest_range as likeliest_range
from jradar.model.grids.view.grid import ViewGrid as ViewGrid
