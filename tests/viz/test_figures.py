"""Figures of captures: what is drawn, and that left is left."""

import jax.numpy as jnp
import numpy as np
from PIL import Image

from jradar.radar import RadarSpec
from jradar.range_image import ImageSpec
from jradar.types import PointCloud
from jradar.viz import (
    capture_figure,
    reliability_figure,
    samples_figure,
    save_figure,
)

RADAR, IMAGE = RadarSpec.awr1642(num_chirps=16, num_samples=32), ImageSpec(8, 16)


def test_a_capture_shows_its_spectrum_clouds_and_range_image(tmp_path):
    cloud = PointCloud.from_xyz(np.array([[3.0, 1, 0.2], [5, -1, 0]]))
    dense = PointCloud.from_xyz(np.array([[4.0, 0.5, 0.1]]))
    lidar = np.array([[2.0, 1, 0], [-2, 0, 0], [50, 0, 0]])  # behind, out of range
    power = np.random.default_rng(0).exponential(size=(16, 32))
    power[3, 20] = 1e4
    figure = capture_figure(
        power, RADAR, cloud, IMAGE, dense=dense, lidar=lidar, title="a room"
    )
    spectrum, above, front = figure.axes
    assert figure.get_suptitle() == "a room"
    bars = [panel.child_axes[0].get_xlabel() for panel in (spectrum, front)]
    assert bars == ["power (dB)", "range (m)"]
    shown = spectrum.images[0].get_array()  # [range, doppler]
    assert np.unravel_index(shown.argmax(), shown.shape) == (20, 3)
    drawn = {line.get_label(): line.get_xydata() for line in above.lines[:3]}
    assert [*drawn] == ["LiDAR: 1", "enhanced: 1", "radar: 2"]
    np.testing.assert_allclose(drawn["radar: 2"][0], [1, 3])  # y to the left, x up
    assert above.xaxis_inverted()
    assert np.isfinite(front.images[0].get_array().filled(np.nan)).sum() == 1
    assert "enhanced" in front.get_title()
    save_figure(figure, tmp_path / "a.png")
    assert Image.open(tmp_path / "a.png").format == "PNG"


def test_a_capture_without_points_is_drawn():
    empty = PointCloud(jnp.zeros((4, 3)), jnp.zeros(4, bool))
    figure = capture_figure(np.ones((16, 32)), RADAR, empty, IMAGE, dense=empty)
    _, above, front = figure.axes
    assert [len(line.get_xydata()) for line in above.lines[:2]] == [0, 0]
    assert np.isnan(front.images[0].get_array().filled(np.nan)).all()


def test_left_is_left():
    image = np.zeros((1, 8, 16))
    image[..., 15] = 6.0  # the highest azimuth: left
    figure = samples_figure({"x": image}, IMAGE)
    assert figure.axes[-1].get_ylabel() == "range (m)"
    shown = figure.axes[0].images[0].get_array()
    assert (
        np.isfinite(shown[:, 0]).all() and np.isnan(shown[:, 1:].filled(np.nan)).all()
    )


def test_reliability_is_drawn_beside_precision_without_empty_bins():
    mean, right = np.array([0.1, np.nan, 0.9]), np.array([0.2, np.nan, 0.7])
    kept, precision = np.array([0.5, 1.0]), np.array([0.9, 0.6])
    names = ("first", "second")
    figure = reliability_figure(
        dict.fromkeys(names, (mean, right)), dict.fromkeys(names, (kept, precision))
    )
    diagram, buys = figure.axes
    diagonal, *lines = diagram.lines
    np.testing.assert_array_equal(*diagonal.get_data())
    np.testing.assert_array_equal(lines[0].get_xydata(), [[0.1, 0.2], [0.9, 0.7]])
    np.testing.assert_array_equal(buys.lines[0].get_xydata(), [[0.5, 0.9], [1, 0.6]])
    for one, other in zip(buys.lines, lines, strict=True):
        assert one.get_color() == other.get_color()
    texts = [text.get_text() for text in figure.legends[0].texts]
    assert texts == ["calibrated", *names]
