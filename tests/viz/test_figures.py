"""Figures: PNG files of a readable size; left is left in pictures."""

import jax.numpy as jnp
import numpy as np
from PIL import Image

from jradar.radar import RadarSpec, direction_sines
from jradar.range_image import ImageSpec
from jradar.types import PointCloud
from jradar.viz import (
    angle_spectra_figure,
    capture_figure,
    samples_figure,
    save_figure,
)

RADAR, IMAGE = RadarSpec.awr1642(num_chirps=16, num_samples=32), ImageSpec(8, 16)


def test_capture_figure_with_and_without_points(tmp_path):
    cloud = PointCloud.from_xyz(np.array([[3.0, 1, 0.2], [5, -1, 0]]))
    empty = PointCloud(jnp.zeros((4, 3)), jnp.zeros(4, bool))
    for name, radar_cloud, dense in (("a", cloud, None), ("b", empty, empty)):
        power = np.random.default_rng(0).exponential(size=(16, 32))
        figure = capture_figure(power, RADAR, radar_cloud, IMAGE, dense=dense)
        save_figure(figure, tmp_path / f"{name}.png")
        assert min(Image.open(tmp_path / f"{name}.png").size) > 300


def test_left_is_left(tmp_path):
    image = np.zeros((1, 8, 16))
    image[..., 15] = 6.0  # the highest azimuth: left
    figure = samples_figure({"x": image}, IMAGE)
    shown = figure.axes[0].images[0].get_array()
    assert (
        np.isfinite(shown[:, 0]).all() and np.isnan(shown[:, 1:].filled(np.nan)).all()
    )
    save_figure(figure, tmp_path / "x.png")


def test_angle_spectra_peak_where_the_target_is_and_left_is_left(tmp_path):
    u, _ = direction_sines(RADAR, num_azimuth=512)
    power = 7 * np.exp(-(((u - np.sin(np.radians(20))) / 0.05) ** 2))
    spectra = {"narrow": power**4, "wide": power}
    figure = angle_spectra_figure(spectra, RADAR, targets_deg=[20.0])
    (axes,) = figure.axes
    truth, *lines = axes.lines
    assert [*truth.get_xdata()] == [20.0, 20.0]
    for line in lines:
        azimuth, level = line.get_data()
        assert level.max() == 0 and abs(azimuth[level.argmax()] - 20) < 0.5
    assert [line.get_label() for line in lines] == ["narrow", "wide"]
    assert axes.xaxis_inverted()
    save_figure(figure, tmp_path / "angles.png")
    assert min(Image.open(tmp_path / "angles.png").size) > 300
