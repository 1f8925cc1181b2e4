"""Calibration: the documented chains in NumPy, what is undone, batches, errors."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import (
    Radar,
    RadarSpec,
    calibrate,
    range_doppler,
    subtract_leakage,
)
from jradar.recordings import radar_from_coloradar, read_coupling

RADAR = RadarSpec.awr1843(num_chirps=8, num_samples=32)
SHAPE = (3, 4, 8, 32)
rng = np.random.default_rng(0)


def noise(*shape):
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


CUBE = noise(*SHAPE)
BINS, CHANNELS = rng.uniform(-1, 1, size=(3, 4)), noise(3, 4)
COUPLING = noise(3, 4, 16) * 100


def close(actual, expected):
    scale = np.abs(expected).max()
    np.testing.assert_allclose(actual, expected, atol=1e-5 * scale)


def test_channel_factors_act_on_tx_major_pairs():
    factors = noise(12)
    unit = Radar(RADAR).with_factors(factors[:12]).with_factors(np.full(12, 2.0))
    actual = calibrate(jnp.array(CUBE), unit)
    for virtual in range(12):
        tx, rx = divmod(virtual, 4)
        close(actual[tx, rx], 2 * CUBE[tx, rx] * factors[virtual])


def test_channels_and_beat_frequencies_follow_the_documented_sums():
    """One antenna pair and one sample at a time."""
    unit = Radar(RADAR, channels=jnp.array(CHANNELS), beat_bins=jnp.array(BINS))
    expected = np.empty(SHAPE, complex)
    for tx, rx, n in np.ndindex(3, 4, 32):
        turn = np.exp(-2j * np.pi * BINS[tx, rx] * n / 32)
        expected[tx, rx, :, n] = CUBE[tx, rx, :, n] * turn * CHANNELS[tx, rx]
    close(calibrate(jnp.array(CUBE), unit), expected)


def test_an_uncalibrated_radar_leaves_the_samples():
    np.testing.assert_array_equal(
        calibrate(jnp.array(CUBE), Radar(RADAR)), jnp.array(CUBE)
    )


def documented_coupling(cube, coupling, doppler_window):
    """Blackman, FFT, bins 1 .. N/2 less the coupling; then the Doppler FFT."""
    n = cube.shape[-1]
    x = 2 * np.pi * np.arange(n) / n
    blackman = 0.42 - 0.5 * np.cos(x) + 0.08 * np.cos(2 * x)
    spectrum = np.fft.fft(cube * blackman)
    spectrum[..., 1 : n // 2 + 1] -= coupling[:, :, None]
    weight = {"none": np.ones(8), "hann": 1 - np.cos(2 * np.pi * np.arange(8) / 8)}
    weight = (weight[doppler_window] / 8)[:, None]
    spectrum = np.fft.fftshift(np.fft.fft(spectrum * weight, axis=-2), axes=-2)
    return spectrum.reshape(12, 8, n)


@pytest.mark.parametrize("doppler_window", ["none", "hann"])
def test_coupling_follows_the_documented_chain(doppler_window):
    window = {"doppler_window": doppler_window}
    spectrum, _ = range_doppler(jnp.array(CUBE), range_window="blackman", **window)
    actual = subtract_leakage(spectrum, jnp.array(COUPLING), **window)
    close(0.42 * 32 * actual, documented_coupling(CUBE, COUPLING, doppler_window))


def test_steady_leakage_vanishes_and_a_moving_target_stays():
    time, chirp = np.arange(32) / 32, np.arange(8)[:, None] / 8
    leakage = 1e4 * np.exp(2j * np.pi * 1.4 * time) * noise(3, 4, 1, 1)
    moving = np.exp(2j * np.pi * (9 * time + 3 * chirp))
    x = 2 * np.pi * time
    blackman = 0.42 - 0.5 * np.cos(x) + 0.08 * np.cos(2 * x)
    coupling = np.fft.fft(leakage[:, :, 0] * blackman)[..., 1:17]
    cube = jnp.array(leakage + moving)
    spectrum, _ = range_doppler(cube, range_window="blackman")
    actual = subtract_leakage(spectrum, jnp.array(coupling))
    assert np.abs(spectrum[:, 4, 1]).min() > 100
    np.testing.assert_allclose(np.abs(actual[:, 4, 1:17]), 0, atol=0.05)
    np.testing.assert_allclose(np.abs(actual[:, 7, 9]), 1, atol=0.05)


def test_batch_equals_the_loop():
    cubes, leakage = jnp.array(noise(2, *SHAPE)), jnp.array(COUPLING)
    unit = Radar(RADAR, channels=jnp.array(CHANNELS), beat_bins=jnp.array(BINS))
    functions = (
        lambda cube: calibrate(cube, unit),
        lambda cube: subtract_leakage(
            range_doppler(cube, range_window="blackman")[0], leakage
        ),
    )
    for function in functions:
        close(function(cubes), np.stack([function(cube) for cube in cubes]))
        close(jax.vmap(function)(cubes), function(cubes))


def test_sizes_that_do_not_fit_are_refused():
    with pytest.raises(
        ValueError, match="8 factors, expected 12: one for each of 3 tx"
    ):
        Radar(RADAR).with_factors(jnp.ones(8, complex))
    with pytest.raises(ValueError, match=r"leakage has shape \(3, 4, 15\), awr1843"):
        Radar(RADAR, leakage=COUPLING[..., 1:])
    with pytest.raises(ValueError, match="Radar of str, expected a RadarSpec"):
        Radar("awr1843")
    spectrum, _ = range_doppler(jnp.array(CUBE), range_window="blackman")
    with pytest.raises(ValueError, match="3 tx x 4 rx x 15 range bins, expected 12"):
        subtract_leakage(spectrum, jnp.array(COUPLING[..., 1:]))
    with pytest.raises(ValueError, match="2 tx x 4 rx x 16"):
        subtract_leakage(spectrum, jnp.array(COUPLING[1:]))


def test_real_coupling_fits_the_single_chip(samples):
    calib = samples / "coloradar_calib_reconstructed" / "single_chip"
    radar = radar_from_coloradar(calib)
    coupling = read_coupling(calib / "coupling_calib.txt")
    silence, _ = range_doppler(jnp.zeros(radar.cube_shape, complex))
    actual = np.asarray(subtract_leakage(silence, jnp.array(coupling)))
    expected = np.zeros((12, 128, 128), complex)
    for doppler, share in ((63, -0.5), (64, 1.0), (65, -0.5)):  # the Hann window's
        expected[:, doppler, 1:65] = -share * coupling.reshape(12, 64) / 0.42 / 128
    close(actual, expected)
