"""Pictures: a capture's spectra and clouds, and samples beside the truth."""

from jradar.viz.figures import (
    capture_figure as capture_figure,
    samples_figure as samples_figure,
    save_figure as save_figure,
)
