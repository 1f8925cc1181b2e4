"""Pictures: captures, samples beside the truth, results; reports as one HTML file.

capture_figure, samples_figure, angle_spectra_figure, preparation_figure
                                 a capture, range images, spectra, a scan step by step
plane_figure                     polar images and clouds in the plane
error_curves_figure, clouds_figure, learning_curve_figure
                                 results: the paper's Fig. 6 and 5, and training
save_figure                      any of them as PNG
write_report, CloudFrame         one HTML file with clouds to turn
"""

from jradar.viz.figures import (
    angle_spectra_figure as angle_spectra_figure,
    capture_figure as capture_figure,
    plane_figure as plane_figure,
    samples_figure as samples_figure,
    save_figure as save_figure,
)
from jradar.viz.page import (
    CloudFrame as CloudFrame,
    write_report as write_report,
)
from jradar.viz.results import (
    clouds_figure as clouds_figure,
    error_curves_figure as error_curves_figure,
    learning_curve_figure as learning_curve_figure,
)
from jradar.viz.steps import preparation_figure as preparation_figure
