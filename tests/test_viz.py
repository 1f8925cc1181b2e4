"""Figures: PNG files of a readable size; left is left in pictures."""

import jax.numpy as jnp
import numpy as np
from PIL import Image

from jradar.radar import RadarSpec
from jradar.range_image import ImageSpec
from jradar.types import PointCloud
from jradar.viz import capture_figure, samples_figure, save_figure

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
