"""Boards: a corner reflector is found where it stands, whatever the array."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import (
    PointSpec,
    Radar,
    RadarSpec,
    Scatterers,
    ca_cfar,
    calibrate,
    power_map,
    radar_points,
    simulate_cube,
)
from jradar.radar.devices import BOARDS, board

CORNER = np.array([3.0, 0.8, 0.4])  # metres: 15 degrees to the left, 7 up
WAVEFORM = {  # of TI's indoor demonstrations, at either band
    "slope_hz_per_s": 60e12,
    "sample_rate_hz": 5e6,
    "num_samples": 128,
    "num_chirps": 16,
    "idle_time_s": 30e-6,
    "adc_start_time_s": 7e-6,
    "ramp_end_time_s": 40e-6,
}
# TI's `antGeometry0`, `antGeometry1` and `antPhaseRot` of the virtual antennas.
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
}


def radar_of(name):
    start_hz = board(name).band_hz[0] + 1e9
    return RadarSpec.named(name, start_frequency_hz=start_hz, **WAVEFORM)


def corner(radar, xyz=CORNER, velocity=0.0):
    """The samples of a corner reflector with a little noise."""
    target = Scatterers(
        jnp.array([xyz], jnp.float32), jnp.array([velocity]), jnp.array([100.0])
    )
    return simulate_cube(jax.random.key(0), target, radar, noise_power=25.0)


@pytest.mark.parametrize("name", BOARDS)
def test_a_moving_corner_is_found_after_its_signs_are_undone(name):
    radar, made = radar_of(name), board(name)
    xyz = CORNER if radar.has_elevation else CORNER * [1, 1, 0]
    signs = jnp.tile(jnp.array(made.rx_signs), radar.num_tx).astype(complex)
    unit = Radar(radar).with_factors(signs)
    recorded = calibrate(corner(radar, xyz, velocity=0.4), unit)
    cloud = radar_points(recorded, unit, points=PointSpec(capacity=16).fitted(radar))
    np.testing.assert_allclose(cloud.xyz[0], xyz, atol=0.06)
    assert cloud.velocity[0] == pytest.approx(0.4, abs=0.05)
    if set(made.rx_signs) != {1}:  # inverted receivers show another direction
        wrong = radar_points(recorded, Radar(radar), points=PointSpec(capacity=16))
        assert np.linalg.norm(wrong.xyz[0] - xyz) > 0.5


@pytest.mark.parametrize("name", TI_TABLES)
def test_positions_and_signs_are_those_of_ti(name):
    columns, rows, signs = map(np.array, TI_TABLES[name])
    positions = np.stack([-columns, rows], -1)
    np.testing.assert_array_equal(
        radar_of(name).virtual_positions, positions - positions.min(0)
    )
    np.testing.assert_array_equal(np.tile(board(name).rx_signs, 3), signs)


def test_rows_of_the_2944_are_further_apart_than_columns():
    radar = radar_of("awr2944")
    table = "1 0 1 1 1 2 1 3 0 2 0 3 0 4 0 5 1 4 1 5 1 6 1 7 1 8 1 9 1 10 1 11"
    row, column = np.array(table.split(), int).reshape(-1, 2).T  # TI's antGeometryCfg
    expected = np.stack([column, 1 - row], -1)  # its rows count downwards
    np.testing.assert_array_equal(radar.virtual_positions, expected)
    ratio = radar.row_spacing_wavelengths / radar.spacing_wavelengths
    assert ratio == pytest.approx(0.8 / 0.5)


def test_real_samples_have_half_the_range_and_the_same_resolution():
    radar = radar_of("awr2944")
    twin = dataclasses.replace(radar, real_samples=False)
    assert radar.num_range_bins == 64 and twin.num_range_bins == 128
    assert radar.max_range_m == pytest.approx(twin.max_range_m / 2)
    cube, complex_cube = corner(radar), corner(twin)
    assert cube.dtype == jnp.float32
    power, expected = power_map(cube), power_map(complex_cube)
    assert power.shape == (16, 64)
    peak = jnp.unravel_index(power.argmax(), power.shape)
    assert peak == jnp.unravel_index(expected.argmax(), expected.shape)
    # A real wave has half of its amplitude at each of two frequencies.
    assert float(power[peak] / expected[peak]) == pytest.approx(1 / 4, rel=0.02)


def test_false_alarms_of_real_noise_are_those_asked_for():
    radar = radar_of("awr2944")
    noise = jax.random.normal(jax.random.key(1), (64, *radar.cube_shape))
    power = jax.vmap(power_map)(noise)
    # Near bin 0 the sums are real, and their power spreads more.
    found = ca_cfar(power, false_alarm_rate=1e-2, channels=radar.num_virtual)
    assert float(found[..., 4:-4].mean()) == pytest.approx(1e-2, rel=0.35)


def test_a_factor_turns_the_phase_of_real_samples():
    radar = radar_of("awr2944")
    cube = corner(radar)
    factors = jnp.exp(1j * jnp.linspace(0, 3, radar.num_virtual))
    unit = Radar(radar).with_factors(factors)
    turned = calibrate(cube, unit)
    assert turned.dtype == jnp.float32
    back = calibrate(turned, Radar(radar).with_factors(factors.conj()))
    np.testing.assert_allclose(back[..., 8:-8], cube[..., 8:-8], atol=20.0)
    cloud = radar_points(back, Radar(radar), points=PointSpec(capacity=16))
    np.testing.assert_allclose(cloud.xyz[0], CORNER, atol=0.06)


def test_samples_of_the_wrong_kind_are_refused():
    radar = radar_of("awr2944")
    with pytest.raises(ValueError, match="awr2944 delivers real ones"):
        radar_points(corner(radar).astype(complex), Radar(radar))
    radar = radar_of("awr1843")
    with pytest.raises(ValueError, match="awr1843 delivers complex ones"):
        radar_points(corner(radar).real, Radar(radar))
