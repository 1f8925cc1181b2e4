"""Figures of captures: what is drawn, and that left is left."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from PIL import Image

from jradar import viz
from jradar.radar import Radar, RadarSpec, Scatterers, simulate_cube
from jradar.range_image import ImageSpec
from jradar.types import PointCloud

RADAR, IMAGE = RadarSpec.awr1642(num_chirps=16, num_samples=32), ImageSpec(8, 16)


def test_a_capture_shows_its_spectrum_clouds_and_range_image(tmp_path):
    cloud = PointCloud.from_xyz(np.array([[3.0, 1, 0.2], [5, -1, 0]]))
    dense = PointCloud.from_xyz(np.array([[4.0, 0.5, 0.1]]))
    lidar = np.array([[2.0, 1, 0], [-2, 0, 0], [50, 0, 0]])  # behind, out of range
    power = np.random.default_rng(0).exponential(size=(16, 32))
    power[3, 20] = 1e4
    azimuths = np.random.default_rng(1).exponential(size=(32, 64))
    azimuths[0, 0], azimuths[20, 48] = 1e9, 1e4  # leakage; an echo at a sine of 0.5
    maps = viz.CaptureMaps(power, azimuths, RADAR)
    figure = viz.capture_figure(
        cloud, IMAGE, maps=maps, dense=dense, lidar=lidar, title="a room"
    )
    spectrum, angles, above, front = figure.axes
    assert figure.get_suptitle() == "a room"
    bars = [panel.child_axes[0].get_xlabel() for panel in (spectrum, angles, front)]
    assert bars == ["power (dB)", "power (dB)", "range (m)"]
    mesh = angles.collections[0]
    assert mesh.get_clim()[1] == pytest.approx(40) and angles.xaxis_inverted()
    azimuth = mesh.get_coordinates()[20, :, 0]
    assert azimuth[48] < 30 < azimuth[49]
    shown = spectrum.images[0].get_array()  # [range, doppler]
    assert np.unravel_index(shown.argmax(), shown.shape) == (20, 3)
    drawn = {line.get_label(): line.get_xydata() for line in above.lines[:3]}
    assert [*drawn] == ["LiDAR: 1", "radar points above the noise: 2", "jradar: 1"]
    np.testing.assert_allclose(
        drawn["radar points above the noise: 2"][0], [1, 3]
    )  # y left, x up
    assert above.xaxis_inverted()
    assert np.isfinite(front.images[0].get_array().filled(np.nan)).sum() == 1
    assert "jradar" in front.get_title()
    viz.save_figure(figure, tmp_path / "a.png")
    assert Image.open(tmp_path / "a.png").format == "PNG"


def test_a_capture_without_points_is_drawn():
    empty = PointCloud(jnp.zeros((4, 3)), jnp.zeros(4, bool))
    maps = viz.CaptureMaps(np.ones((16, 32)), np.ones((16, 32)), RADAR)
    figure = viz.capture_figure(empty, IMAGE, maps=maps, dense=empty)
    *_, above, front = figure.axes
    assert [len(line.get_xydata()) for line in above.lines[:2]] == [0, 0]
    assert np.isnan(front.images[0].get_array().filled(np.nan)).all()


def test_confidence_colours_the_cloud_and_the_verdict_stands_below_the_title():
    cloud = PointCloud.from_xyz(np.array([[3.0, 1, 0.2]]))
    dense = PointCloud.from_xyz(np.array([[4.0, 0.5, 0.1], [5, 0, 0]]))
    dense = dense._replace(confidence=jnp.array([0.9, 0.2]))
    verdict = "55% of its points may be right"
    figure = viz.capture_figure(cloud, IMAGE, dense=dense, title="a", verdict=verdict)
    (drawn,) = figure.axes[0].collections
    np.testing.assert_allclose(drawn.get_array(), [0.2, 0.9], rtol=1e-6)  # surest last
    np.testing.assert_allclose(drawn.get_offsets(), [[0, 5], [0.5, 4]], atol=1e-6)
    assert drawn.get_clim() == (0, 1) and drawn.get_label() == "jradar: 2"
    assert figure.get_suptitle() == f"a\n{verdict}"


def test_points_that_a_radar_sent_are_drawn_without_maps():
    cloud = PointCloud.from_xyz(np.array([[3.0, 1, 0.2], [5, -1, 0]]))
    figure = viz.capture_figure(cloud, IMAGE)
    above, front = figure.axes
    assert above.lines[0].get_label() == "radar points: 2"
    assert front.get_title() == "range image of the radar points"


def test_maps_of_a_cube_have_an_echo_in_its_place():
    spec = RadarSpec.awr1843(num_chirps=16, num_samples=64)
    place = spec.range_resolution_m * 20 * np.array([[np.cos(0.5), np.sin(0.5), 0]])
    echo = Scatterers(jnp.asarray(place), jnp.array([0.0]), jnp.array([1.0]))
    cube = simulate_cube(jax.random.key(0), echo, spec, noise_power=1e-6)
    (doppler,) = viz.range_doppler(cube, Radar(spec)).axes
    shown = doppler.images[0].get_array()
    assert np.unravel_index(shown.argmax(), shown.shape) == (20, 8)
    (angles,) = viz.range_azimuth(cube, Radar(spec)).axes
    mesh = angles.collections[0]
    row, column = np.unravel_index(mesh.get_array().argmax(), mesh.get_array().shape)
    left, right = mesh.get_coordinates()[row, column : column + 2, 0]
    assert row == 20 and left < np.degrees(0.5) + 1 and right > np.degrees(0.5) - 1


def test_left_is_left():
    image = np.zeros((1, 8, 16))
    image[..., 15] = 6.0  # the highest azimuth: left
    figure = viz.samples_figure({"x": image}, IMAGE)
    assert figure.axes[-1].get_ylabel() == "range (m)"
    shown = figure.axes[0].images[0].get_array()
    assert np.isfinite(shown[:, 0]).all()
    assert np.isnan(shown[:, 1:].filled(np.nan)).all()


def test_reliability_is_drawn_beside_precision_without_empty_bins():
    mean, right = np.array([0.1, np.nan, 0.9]), np.array([0.2, np.nan, 0.7])
    kept, precision = np.array([0.5, 1.0]), np.array([0.9, 0.6])
    names = ("first", "second")
    figure = viz.reliability_figure(
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


def test_a_cloud_is_shown_from_above_and_from_the_side():
    cloud = PointCloud.from_xyz(np.array([[3.0, 1, 0.2], [5, -1, 0], [0, 0, 0]]))
    above, side, bar = viz.show(cloud).axes
    assert bar.get_ylabel() == "height (m)"
    for panel, axis in ((above, 1), (side, 2)):
        drawn = np.asarray(panel.collections[0].get_offsets())
        np.testing.assert_allclose(drawn, np.asarray(cloud.xyz)[[1, 0]][:, [0, axis]])
    sure = viz.show(cloud._replace(confidence=jnp.array([0.2, 0.9, 1.0])))
    assert sure.axes[2].get_ylabel() == "confidence"
    np.testing.assert_allclose(sure.axes[0].collections[0].get_array(), [0.2, 0.9])
