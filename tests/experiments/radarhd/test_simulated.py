"""Simulated pairs: a wall and a target land where RadarHD's images have them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.radarhd.pairs import LIDAR, RADAR, open_radarhd
from experiments.radarhd.simulated import (
    CHIP,
    MOMENTS_S,
    OFFSET_M,
    RANGE_STEP_M,
    layout,
    lidar_image,
    main,
    radar_image,
)
from jradar.radar import Scatterers, simulate_cube


def test_range_bins_are_radarhds():
    assert CHIP.range_resolution_m == pytest.approx(RANGE_STEP_M, rel=0.003)


@pytest.mark.parametrize("degrees", [-30, 0, 40])
def test_the_brightest_pixel_is_the_target(degrees):
    azimuth = np.deg2rad(degrees)
    xyz = 5.0 * np.array([[np.cos(azimuth), np.sin(azimuth), 0]])
    echo = Scatterers(jnp.asarray(xyz), jnp.zeros(1), jnp.ones(1))
    cube = np.asarray(simulate_cube(jax.random.key(0), echo, CHIP))
    row, column = np.unravel_index(radar_image(cube).argmax(), RADAR.shape)
    assert RADAR.ranges[row] == pytest.approx(5.0, abs=0.06)
    assert np.rad2deg(RADAR.angles[column]) == pytest.approx(degrees, abs=6)


def test_a_lower_threshold_keeps_more_pixels():
    places = jnp.asarray([[3.0, 0, 0], [6.0, 1, 0]])
    echo = Scatterers(places, jnp.zeros(2), jnp.asarray([1.0, 0.02]))
    cube = np.asarray(simulate_cube(jax.random.key(0), echo, CHIP))
    far = RADAR.ranges > 5
    assert not radar_image(cube)[far].any()
    assert radar_image(cube, threshold=0.01)[far].any()


def test_the_slice_holds_what_is_level_with_the_sensor_and_in_front():
    points = np.array(
        [[4.0, 0, 0], [4, 1, 0.2], [4, -1, 0.5], [-4, 0, 0], [11, 0, 0], [0.5, 10.5, 0]]
    )
    row, column = np.nonzero(lidar_image(points))
    assert len(row) == 2
    np.testing.assert_allclose(LIDAR.ranges[row], [4, np.sqrt(17.04)], atol=0.05)
    azimuth = np.arctan2([0, 1], 4)
    np.testing.assert_allclose(LIDAR.angles[column], azimuth, atol=0.007)


def test_a_unit_differs_from_layout_to_layout_but_not_in_its_chirp():
    settings = [layout("home", seed) for seed in (0, 1)]
    assert settings[0].unit != settings[1].unit
    for setting in settings:
        radar, hardware = setting.radars["single_chip"]
        assert radar == CHIP
        late_m = hardware.frequency * CHIP.range_resolution_m
        np.testing.assert_allclose(late_m, OFFSET_M)


@pytest.mark.slow
def test_layouts_become_a_packed_file(tmp_path, capsys):
    out = tmp_path / "pairs.npz"
    main([str(out), "--layouts=2", "--first=3"])
    pairs = open_radarhd(out)
    assert f"{len(pairs)} pairs of 2 layouts" in capsys.readouterr().out
    assert len(pairs) <= 2 * len(MOMENTS_S)
    assert {*pairs.keys[:, 0].tolist()} == {3, 4}
    assert all(pair.lidar.any() and pair.radar.any() for pair in pairs)
    again = tmp_path / "again.npz"
    main([str(again), "--layouts=1", "--first=3"])
    np.testing.assert_array_equal(open_radarhd(again)[0].radar, pairs[0].radar)
    with pytest.raises(SystemExit):
        main([str(out), "--layouts=0"])
