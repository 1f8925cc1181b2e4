"""Pictures: a capture's spectra and clouds, a scan's preparation, samples, spectra."""

from jradar.viz.figures import (
    angle_spectra_figure as angle_spectra_figure,
    capture_figure as capture_figure,
    samples_figure as samples_figure,
    save_figure as save_figure,
)
from jradar.viz.preparation import preparation_figure as preparation_figure
