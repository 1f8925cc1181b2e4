"""Crossing chirps: where and how long they are heard, and that excision restores."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import (
    Interferers,
    PointSpec,
    Radar,
    RadarSpec,
    crossing_chirps,
    draw_interferers,
    excise_interference,
    power_map,
    radar_points,
)
from jradar.radar.clean.interference import EDGE, _median, _taper
from tests.radar.targets import CELLS, SMALL, simulate, target

KEY = jax.random.key(0)
REAL = dataclasses.replace(SMALL, real_samples=True)
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


def strong_and_often(radar=SMALL, seed=1):
    interferers = draw_interferers(
        jax.random.key(seed), radar, count=6, amplitude=300.0
    )
    return crossing_chirps(KEY, interferers, radar)


@pytest.mark.parametrize("radar", [SMALL, REAL], ids=["complex", "real"])
def test_a_crossing_lasts_as_long_as_its_beat_is_in_the_band(radar):
    samples = crossing_chirps(KEY, one_sweep(radar), radar)
    level = np.abs(samples[0, :, 0]).max(0)
    heard = np.flatnonzero(level > 0.2)
    assert abs(len(heard) - LENGTH) <= 2 and abs(heard.mean() - MIDDLE) <= 1
    assert not samples[1:].any() and not samples[:, :, 1:].any()
    assert level.max() == pytest.approx(2, abs=0.1)


def test_the_beat_sweeps_with_the_difference_of_the_slopes():
    samples = np.asarray(crossing_chirps(KEY, one_sweep(), SMALL))[0, 0, 0]
    inside = slice(MIDDLE - 6, MIDDLE + 7)
    step = np.angle(samples[1:] * samples[:-1].conj())[inside] / (2 * np.pi)
    between = np.arange(SMALL.num_samples - 1)[inside] + 0.5 - MIDDLE
    np.testing.assert_allclose(np.mod(step, 1), 0.5 + between / LENGTH, atol=0.01)


def test_receivers_hear_the_direction():
    samples = np.asarray(crossing_chirps(KEY, one_sweep(), SMALL))[0, :, 0, MIDDLE]
    u, w = np.sin(0.3) * np.cos(0.2), np.sin(0.2)
    turns = [
        SMALL.spacing_wavelengths * a * u + SMALL.row_spacing_wavelengths * e * w
        for a, e in SMALL.rx_positions
    ]
    expected = np.exp(2j * np.pi * (np.array(turns) - turns[0]))
    np.testing.assert_allclose(samples / samples[0], expected, atol=1e-4)


@pytest.mark.parametrize("length", [8, 0.25], ids=["slow", "faster_than_a_sample"])
def test_the_energy_is_that_of_the_time_in_the_band(length):
    energies = [
        np.sum(np.abs(crossing_chirps(KEY, one_sweep(SMALL, length, at), SMALL)) ** 2)
        for at in MIDDLE + np.arange(32) / 32
    ]
    expected = 2**2 * SMALL.num_rx * length * (1 - EDGE / 2)
    np.testing.assert_allclose(np.mean(energies), expected, rtol=0.05)


def test_drawn_interferers_cross_many_chirps_in_all_receivers_at_once():
    samples = np.asarray(strong_and_often())
    assert np.isfinite(samples).all()
    heard = samples != 0
    assert (heard == heard[:, :1]).all()
    assert 0.2 < heard.any((1, 3)).mean() <= 1


@pytest.mark.parametrize("radar", [SMALL, REAL], ids=["complex", "real"])
def test_excision_gives_back_a_weak_target(radar):
    strong = simulate(target(3, 10, 0, 0.0, amplitude=500.0), radar)
    clean = strong + simulate(target(4.5, -20, 3, 1.2, amplitude=1.0), radar, seed=1)
    disturbed = clean + strong_and_often(radar)
    excised, found = excise_interference(disturbed)

    def snr_db(cube):
        power = np.asarray(power_map(cube))
        bins = [round(4.5 / radar.range_resolution_m), 16]
        bins[1] += round(1.2 / radar.velocity_resolution_mps)
        near = power[bins[1] - 1 : bins[1] + 2, bins[0] - 1 : bins[0] + 2]
        return 10 * np.log10(near.max() / np.median(power))

    assert snr_db(clean) > 15
    assert snr_db(disturbed) < snr_db(clean) - 10
    assert snr_db(excised) > snr_db(clean) - 1
    kept = ~np.asarray(found)[:, None].repeat(4, 1)
    np.testing.assert_array_equal(excised[kept], disturbed[kept])


@pytest.mark.parametrize("radar", [SMALL, REAL], ids=["complex", "real"])
@pytest.mark.parametrize("velocity", [0.0, 1.37])
def test_a_clean_frame_with_a_strong_target_is_returned_bit_for_bit(radar, velocity):
    cube = simulate(target(3.21, 10, 5, velocity, amplitude=1000.0), radar)
    excised, found = excise_interference(cube)
    assert not found.any()
    np.testing.assert_array_equal(excised, cube)


@pytest.mark.parametrize("count", [1, 2, 7, 32])
def test_the_median_is_that_of_a_sort(count):
    power = np.random.default_rng(count).gamma(0.2, 1e6, (2, 3, count, 5))
    power[0, :, : (count + 1) // 2] = 0  # many are equal
    power = jnp.asarray(power, jnp.float32)
    for axes in ((-3, -2), (-2, -1)):
        expected = np.median(np.asarray(power), axes, keepdims=True)
        np.testing.assert_array_equal(_median(power, axes), expected)


@pytest.mark.parametrize("radar", [SMALL, REAL], ids=["complex", "real"])
def test_noise_is_excised_at_the_rate_that_was_asked(radar):
    silence = target(5, 0, 0, 0, amplitude=0.0)
    rate, radar = 1e-3, dataclasses.replace(radar, num_chirps=512)
    _, found = excise_interference(simulate(silence, radar), false_alarm_rate=rate)
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


def test_vmap_equals_the_loop():
    cubes = jnp.stack([simulate(target(3, 0, 0, 1), seed=i) for i in range(2)])
    cubes = cubes + jnp.stack([strong_and_often(seed=i) for i in range(2)])
    excised, found = jax.vmap(excise_interference)(cubes)
    batched, _ = excise_interference(cubes)
    assert found.any()
    for i, cube in enumerate(cubes):
        np.testing.assert_allclose(excised[i], excise_interference(cube)[0], atol=1e-3)
        np.testing.assert_allclose(batched[i], excised[i], atol=1e-3)


def test_points_are_those_of_the_frame_without_interference():
    clean = simulate(target(5, 20, 5, 1, amplitude=10.0))
    disturbed = clean + strong_and_often()
    options = dataclasses.replace(CELLS, false_alarm_rate=1e-8)
    excising = dataclasses.replace(options, remove_interference=True)
    expected = radar_points(clean, Radar(SMALL), points=options)
    cloud = radar_points(disturbed, Radar(SMALL), points=excising)
    lost = radar_points(disturbed, Radar(SMALL), points=options)
    assert cloud.valid[0] and jnp.linalg.norm(cloud.xyz[0] - expected.xyz[0]) < 0.1
    assert cloud.snr[0] > 0.8 * expected.snr[0] > 8 * lost.snr[0]
    assert PointSpec().remove_interference is False


def test_a_radar_of_another_band_hears_nothing():
    radar = RadarSpec.awr1843(num_chirps=32, num_samples=64)
    far = one_sweep()._replace(start_hz=jnp.array([20e9], jnp.float32))
    assert not crossing_chirps(KEY, far, radar).any()
