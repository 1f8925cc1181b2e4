"""Simulated pairs: a wall and a target land where RadarHD's images have them."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.tasks.radarhd_pairs import LIDAR, RADAR, open_radarhd
from experiments.tasks.radarhd_simulated import (
    OFFSET_M,
    first_row,
    lidar_image,
    main,
    radar_image,
)
from jradar.radar import Scatterers, simulate_cube
from tests.recordings.small_sequence import write_calib, write_sequence


@pytest.fixture(scope="module")
def radar(tmp_path_factory):
    return write_calib(tmp_path_factory.mktemp("radar"))


@pytest.mark.parametrize("degrees", [-30, 0, 40])
def test_the_brightest_pixel_is_the_target(radar, degrees):
    azimuth = np.deg2rad(degrees)
    xyz = 5.0 * np.array([[np.cos(azimuth), np.sin(azimuth), 0]])
    echo = Scatterers(jnp.asarray(xyz), jnp.zeros(1), jnp.ones(1))
    cube = np.asarray(simulate_cube(jax.random.key(0), echo, radar))
    row, column = np.unravel_index(radar_image(cube, radar).argmax(), RADAR.shape)
    assert RADAR.ranges[row] == pytest.approx(5.0 + OFFSET_M, abs=0.1)
    assert np.rad2deg(RADAR.angles[column]) == pytest.approx(degrees, abs=6)


def test_antennas_with_gaps_are_refused(radar):
    cube = np.ones(radar.cube_shape, np.complex64)
    assert first_row(cube, radar).shape == (8, radar.num_samples)
    apart = dataclasses.replace(radar, tx_positions=((0, 0), (5, 0), (2, 1)))
    with pytest.raises(ValueError, match="expected a row without gaps"):
        first_row(cube, apart)


def test_the_slice_holds_what_is_level_with_the_sensor_and_in_front():
    points = np.array(
        [[4.0, 0, 0], [4, 1, 0.2], [4, -1, 0.5], [-4, 0, 0], [11, 0, 0], [0.5, 10.5, 0]]
    )
    row, column = np.nonzero(lidar_image(points))
    assert len(row) == 2
    np.testing.assert_allclose(LIDAR.ranges[row], [4, np.sqrt(17.04)], atol=0.05)
    azimuth = np.arctan2([0, 1], 4)
    np.testing.assert_allclose(LIDAR.angles[column], azimuth, atol=0.007)


def test_recordings_become_a_packed_file(tmp_path, capsys):
    write_sequence(tmp_path / "source", "home_0", frames=2, seed=0)
    main([str(tmp_path / "source"), str(tmp_path / "pairs.npz"), "--families=home"])
    pairs = open_radarhd(tmp_path / "pairs.npz")
    assert "2 pairs" in capsys.readouterr().out
    assert pairs.keys.tolist() == [[0, 0], [0, 1]]
    assert pairs[0].lidar.any() and pairs[0].radar.any()
    with pytest.raises(SystemExit):
        main([str(tmp_path), str(tmp_path / "none.npz")])
