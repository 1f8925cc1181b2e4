"""Boards: a corner reflector is found where it stands, whatever the array."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.options.boards import BOARDS
from jradar.radar import PointSpec, Radar, RadarSpec, ca_cfar, calibrate, radar_points
from jradar.radar.spectrum import power_map
from tests.radar.targets import cloud_of, simulate, spherical, target

CORNER = 3.13, 15.0, 7.0  # metres, degrees to the left and up
WAVEFORM = {"slope_hz_per_s": 60e12, "sample_rate_hz": 5e6, "idle_time_s": 30e-6}
WAVEFORM |= {"num_samples": 128, "num_chirps": 16}  # of TI's indoor demonstrations
WAVEFORM |= {"adc_start_time_s": 7e-6, "ramp_end_time_s": 40e-6}
# TI's `antGeometry0`, `antGeometry1` and `antPhaseRot` of the virtual antennas; rows of
# `antGeometryCfg` count downwards.
TI_TABLES = {
    "iwr6843isk": (
        (0, -1, -2, -3, -2, -3, -4, -5, -4, -5, -6, -7),
        (-1, -1, -1, -1, 0, 0, 0, 0, -1, -1, -1, -1),
        (1,) * 12,
    ),
    "iwr6843ods": (
        (0, 0, -1, -1, -2, -2, -3, -3, -2, -2, -3, -3),
        (0, -1, -1, 0, 0, -1, -1, 0, -2, -3, -3, -2),
        (1, -1, -1, 1) * 3,
    ),
    "iwr6843aop": (
        (-1, -1, 0, 0, -3, -3, -2, -2, -1, -1, 0, 0),
        (-1, 0, -1, 0, -3, -2, -3, -2, -3, -2, -3, -2),
        (1, -1) * 6,
    ),
    "awr2944": (
        (0, -1, -2, -3, -2, -3, -4, -5, -4, -5, -6, -7, -8, -9, -10, -11),
        (-1, -1, -1, -1, 0, 0, 0, 0, -1, -1, -1, -1, -1, -1, -1, -1),
        (1,) * 16,
    ),
}


def radar_of(name):
    start_hz = BOARDS[name].band_hz[0] + 1e9
    return RadarSpec.named(name, start_frequency_hz=start_hz, **WAVEFORM)


def corner(radar, velocity=0.0):
    """The samples of a corner reflector with a little noise."""
    return simulate(target(*CORNER, velocity), radar, noise_power=25.0)


REAL = radar_of("awr2944")
POINTS = PointSpec(capacity=16).fitted(REAL)


def assert_found(cloud):
    found = [values[0] for values in spherical(cloud.xyz[:1])]
    assert found[0] == pytest.approx(CORNER[0], abs=0.05)
    np.testing.assert_allclose(np.degrees(found[1:]), CORNER[1:], atol=1)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["awr2944", "iwr6843ods", "iwr6843aop"])
def test_a_moving_corner_is_found_after_its_signs_are_undone(name):
    """Boards of arrays that no other test simulates."""
    radar, made = radar_of(name), BOARDS[name]
    signs = np.tile(made.rx_signs, radar.num_tx)
    unit = Radar(radar).with_factors(signs)
    recorded = calibrate(corner(radar, velocity=0.4), unit)
    cloud = cloud_of(recorded, unit, POINTS)
    assert_found(cloud)
    assert cloud.velocity[0] == pytest.approx(0.4, abs=0.05)
    if set(made.rx_signs) != {1}:  # inverted receivers show another direction
        plain = Radar(radar).with_factors(np.ones(radar.num_virtual))
        wrong = cloud_of(recorded, plain, POINTS)
        assert np.linalg.norm(wrong.xyz[0] - cloud.xyz[0]) > 0.5


@pytest.mark.parametrize("name", TI_TABLES)
def test_positions_and_signs_are_those_of_ti(name):
    columns, rows, signs = map(np.array, TI_TABLES[name])
    positions = np.stack([-columns, rows], -1)
    expected = positions - positions.min(0)
    np.testing.assert_array_equal(radar_of(name).virtual_positions, expected)
    found = np.tile(BOARDS[name].rx_signs, radar_of(name).num_tx)
    np.testing.assert_array_equal(found, signs)


def test_boards_of_one_layout_have_its_positions():
    isk = BOARDS["iwr6843isk"]
    for name in ("awr1443", "awr1843"):
        assert BOARDS[name].tx_positions == isk.tx_positions
        assert BOARDS[name].rx_positions == isk.rx_positions
    assert len(BOARDS) == 7 and not radar_of("awr1642").has_elevation
    ratio = REAL.row_spacing_wavelengths / REAL.spacing_wavelengths
    assert ratio == pytest.approx(0.8 / 0.5)  # between rows and columns of the 2944


def test_real_samples_have_half_the_range_and_the_same_resolution():
    twin = dataclasses.replace(REAL, real_samples=False)
    assert REAL.num_range_bins == 64 and twin.num_range_bins == 128
    assert REAL.max_range_m == pytest.approx(twin.max_range_m / 2)
    cube, complex_cube = corner(REAL), corner(twin)
    assert cube.dtype == jnp.float32
    power, expected = map(np.asarray, (power_map(cube), power_map(complex_cube)))
    assert power.shape == (16, 64)
    peak = np.unravel_index(power.argmax(), power.shape)
    assert peak == np.unravel_index(expected.argmax(), expected.shape)
    # A real wave has half of its amplitude at each of two frequencies.
    assert power[peak] / expected[peak] == pytest.approx(1 / 4, rel=0.02)


def test_false_alarms_of_real_noise_are_those_asked_for():
    noise = jax.random.normal(jax.random.key(1), (64, *REAL.cube_shape))
    # Near bin 0 the sums are real, and their power spreads more.
    found = ca_cfar(power_map(noise), false_alarm_rate=1e-2, channels=REAL.num_virtual)
    assert np.asarray(found)[..., 4:-4].mean() == pytest.approx(1e-2, rel=0.35)


def test_a_factor_turns_the_phase_of_real_samples():
    cube = corner(REAL)
    factors = np.exp(1j * np.linspace(0, 3, REAL.num_virtual))
    turned = calibrate(cube, Radar(REAL).with_factors(factors))
    assert turned.dtype == jnp.float32
    unit = Radar(REAL).with_factors(factors.conj())
    back = calibrate(turned, unit)
    np.testing.assert_allclose(back[..., 8:-8], cube[..., 8:-8], atol=20.0)
    assert_found(cloud_of(turned, unit, POINTS))


def test_samples_of_the_wrong_kind_are_refused():
    for radar, kind, message in (
        (REAL, complex, "awr2944 delivers real ones"),
        (radar_of("awr1843"), float, "awr1843 delivers complex ones"),
    ):
        with pytest.raises(ValueError, match=message):
            radar_points(jnp.zeros(radar.cube_shape, kind), Radar(radar))
