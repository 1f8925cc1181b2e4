"""Figures with matplotlib, and a page with point clouds.

range_doppler, range_azimuth     the power of a cube
capture_figure                   a radar frame: maps of power, clouds, range image
samples_figure                   range images side by side
reliability_figure               whether confidence holds, and the precision it buys
preparation_figure               the preparation of a LiDAR scan, step by step
error_curves_figure, clouds_figure, learning_curve_figure
                                 results: the paper's Fig. 6 and 5, and training
bars_figure                      a number of each method in groups, such as distances
velocities_figure                a radar's velocities by Doppler and by poses
maps_figure                      maps side by side, from above and from the side
video.VideoWriter                frames from above, one after another
save_figure                      any of them as PNG
write_page, CloudFrame           one HTML file with point clouds that can be rotated
"""

from jradar.viz.figures import (
    capture_figure as capture_figure,
    range_azimuth as range_azimuth,
    range_doppler as range_doppler,
    reliability_figure as reliability_figure,
    samples_figure as samples_figure,
    save_figure as save_figure,
)
from jradar.viz.maps import maps_figure as maps_figure, show as show
from jradar.viz.page import CloudFrame as CloudFrame, write_page as write_page
from jradar.viz.results import (
    bars_figure as bars_figure,
    clouds_figure as clouds_figure,
    error_curves_figure as error_curves_figure,
    learning_curve_figure as learning_curve_figure,
    velocities_figure as velocities_figure,
)
from jradar.viz.steps import preparation_figure as preparation_figure
