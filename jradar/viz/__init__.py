"""Pictures: a capture's spectra and clouds, a scan's preparation, samples and truth."""

from jradar.viz.figures import (
    capture_figure as capture_figure,
    samples_figure as samples_figure,
    save_figure as save_figure,
)
from jradar.viz.preparation import preparation_figure as preparation_figure
