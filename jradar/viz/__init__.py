"""Figures with matplotlib.

figure = show(cloud)                    # from above and from the side
save_figure(figure, "cloud.png")
"""

from jradar.viz.figures import (
    CaptureMaps as CaptureMaps,
    capture_figure as capture_figure,
    range_azimuth as range_azimuth,
    range_doppler as range_doppler,
    reliability_figure as reliability_figure,
    samples_figure as samples_figure,
    save_figure as save_figure,
)
from jradar.viz.maps import maps_figure as maps_figure, show as show
from jradar.viz.results import (
    bars_figure as bars_figure,
    learning_curve_figure as learning_curve_figure,
    velocities_figure as velocities_figure,
)
from jradar.viz.steps import preparation_figure as preparation_figure
