"""Crossing chirps: where and how long they are heard, and that excision restores."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import (
    crossing_chirps,
    draw_interferers,
    excise_interference,
    power_map,
)
from jradar.radar.clean.interference import EDGE, Interferers, _median, _taper
from tests.radar.targets import CELLS, SMALL, cloud_of, simulate, target

KEY = jax.random.key(0)
REAL = dataclasses.replace(SMALL, real_samples=True)
KINDS = pytest.mark.parametrize("radar", [SMALL, REAL], ids=["complex", "real"])
MIDDLE, LENGTH = 30, 16  # sample of the crossing, and samples in the band


def one_sweep(radar=SMALL, length=LENGTH, middle=MIDDLE):
    """One sweep of amplitude 2 that crosses the first chirp at `middle`."""
    slower = radar.sample_rate_hz**2 / length
    middle_s = radar.adc_start_time_s + middle / radar.sample_rate_hz
    band_hz = 0 if radar.real_samples else radar.sample_rate_hz / 2
    begin_s = -1e-6
    slope = radar.slope_hz_per_s - slower
    start_hz = radar.slope_hz_per_s * middle_s - slope * (middle_s - begin_s) - band_hz
    values = (begin_s, 1.0, 40e-6, start_hz, slope, 0.3, 0.2, 2.0)
    return Interferers(*(jnp.array([value], jnp.float32) for value in values))


def crossing(sweep, radar=SMALL):
    return np.asarray(crossing_chirps(KEY, sweep, radar))


def strong_and_often(radar=SMALL, seed=1):
    key = jax.random.key(seed)
    return crossing(draw_interferers(key, radar, count=6, amplitude=300.0), radar)


@KINDS
def test_a_crossing_lasts_as_long_as_its_beat_is_in_the_band(radar):
    samples = crossing(one_sweep(radar), radar)
    level = np.abs(samples[0, :, 0]).max(0)
    heard = np.flatnonzero(level > 0.2)
    assert abs(len(heard) - LENGTH) <= 2 and abs(heard.mean() - MIDDLE) <= 1
    assert not samples[1:].any() and not samples[:, :, 1:].any()
    assert level.max() == pytest.approx(2, abs=0.1)


def test_the_beat_sweeps_with_the_difference_of_the_slopes_and_shows_the_direction():
    samples = crossing(one_sweep())[0, :, 0]
    inside = slice(MIDDLE - 6, MIDDLE + 7)
    step = np.angle(samples[0, 1:] * samples[0, :-1].conj())[inside] / (2 * np.pi)
    between = np.arange(SMALL.num_samples - 1)[inside] + 0.5 - MIDDLE
    np.testing.assert_allclose(np.mod(step, 1), 0.5 + between / LENGTH, atol=0.01)
    u, w = np.sin(0.3) * np.cos(0.2), np.sin(0.2)
    columns, rows = np.array(SMALL.rx_positions).T
    turns = SMALL.spacing_wavelengths * columns * u
    turns = turns + SMALL.row_spacing_wavelengths * rows * w
    found = samples[:, MIDDLE] / samples[0, MIDDLE]
    expected = np.exp(2j * np.pi * (turns - turns[0]))
    np.testing.assert_allclose(found, expected, atol=1e-4)


@pytest.mark.parametrize("length", [8, 0.25], ids=["slow", "faster_than_a_sample"])
def test_the_energy_is_that_of_the_time_in_the_band(length):
    middles = MIDDLE + np.arange(32) / 32
    energies = [np.abs(crossing(one_sweep(SMALL, length, at))) ** 2 for at in middles]
    expected = 2**2 * SMALL.num_rx * length * (1 - EDGE / 2)
    np.testing.assert_allclose(np.sum(energies) / 32, expected, rtol=0.05)


def test_drawn_interferers_cross_many_chirps_in_all_receivers_at_once():
    samples = strong_and_often()
    assert np.isfinite(samples).all()
    heard = samples != 0
    assert (heard == heard[:, :1]).all()
    assert 0.2 < heard.any((1, 3)).mean() <= 1


def test_a_radar_of_another_band_hears_nothing():
    far = one_sweep()._replace(start_hz=jnp.array([20e9], jnp.float32))
    assert not crossing(far).any()


@KINDS
def test_excision_gives_back_a_weak_target(radar):
    strong = simulate(target(3, 10, 0, 0.0, amplitude=500.0), radar)
    clean = strong + simulate(target(4.5, -20, 3, 1.2, amplitude=1.0), radar, seed=1)
    disturbed = np.asarray(clean + strong_and_often(radar))
    excised, found = map(np.asarray, excise_interference(disturbed))

    def snr_db(cube):
        power = np.asarray(power_map(cube))
        column = round(4.5 / radar.range_resolution_m)
        row = 16 + round(1.2 / radar.velocity_resolution_mps)
        near = power[row - 1 : row + 2, column - 1 : column + 2]
        return 10 * np.log10(near.max() / np.median(power))

    assert snr_db(clean) > 15
    assert snr_db(disturbed) < snr_db(clean) - 10
    assert snr_db(excised) > snr_db(clean) - 1
    kept = ~found[:, None].repeat(4, 1)
    np.testing.assert_array_equal(excised[kept], disturbed[kept])


@KINDS
@pytest.mark.parametrize("velocity", [0.0, 1.37])
def test_a_clean_frame_with_a_strong_target_is_returned_bit_for_bit(radar, velocity):
    cube = simulate(target(3.21, 10, 5, velocity, amplitude=1000.0), radar)
    excised, found = excise_interference(cube)
    assert not found.any()
    np.testing.assert_array_equal(excised, cube)


@pytest.mark.parametrize("count", [1, 2, 7])
def test_the_median_is_that_of_a_sort(count):
    power = np.random.default_rng(count).gamma(0.2, 1e6, (2, 3, count, 5))
    power[0, :, : (count + 1) // 2] = 0  # many are equal
    power = np.float32(power)
    for axes in ((-3, -2), (-2, -1)):
        expected = np.median(power, axes, keepdims=True)
        np.testing.assert_array_equal(_median(jnp.asarray(power), axes), expected)


@KINDS
def test_noise_is_excised_at_the_rate_that_was_asked(radar):
    rate, radar = 1e-3, dataclasses.replace(radar, num_chirps=512)
    silence = simulate(target(5, 0, 0, 0, amplitude=0.0), radar)
    _, found = excise_interference(silence, false_alarm_rate=rate)
    sure = _taper(512, 64) > 0.3
    # Each sample that is found takes its two neighbours along.
    np.testing.assert_allclose(np.asarray(found)[:, sure].mean(), 3 * rate, rtol=0.3)


def test_frames_without_noise_or_without_a_second_chirp_are_returned():
    zeros = jnp.zeros(SMALL.cube_shape, jnp.complex64)
    single = simulate(target(3, 0, 0, 0))[:, :, :1]
    for cube in (zeros, single):
        excised, found = excise_interference(cube)
        assert not found.any()
        np.testing.assert_array_equal(excised, cube)


def test_points_are_those_of_the_frame_without_interference():
    clean = simulate(target(5, 20, 5, 1, amplitude=10.0))
    disturbed = clean + strong_and_often()
    excising = dataclasses.replace(CELLS, remove_interference=True)
    expected, lost = (cloud_of(cube) for cube in (clean, disturbed))
    cloud = cloud_of(disturbed, points=excising)
    assert cloud.valid[0] and np.linalg.norm(cloud.xyz[0] - expected.xyz[0]) < 0.1
    assert cloud.snr[0] > 0.8 * expected.snr[0] > 8 * lost.snr[0]
    assert CELLS.remove_interference is False
