"""Calibration: the documented chains in NumPy, what is undone, batches, errors."""

import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import (
    Radar,
    RadarSpec,
    calibrate,
    compensate_tdm,
    range_doppler,
    subtract_leakage,
)
from tests.radar.targets import CASCADE, noise

RADAR = RadarSpec.awr1843(num_chirps=8, num_samples=32)
SHAPE = (3, 4, 8, 32)
CUBE, CHANNELS = noise(*SHAPE), noise(3, 4, seed=1)
BINS = np.random.default_rng(0).uniform(-1, 1, size=(3, 4))
COUPLING = 100 * noise(3, 4, 16, seed=2)
UNIT = Radar(RADAR, channels=jnp.array(CHANNELS), beat_bins=jnp.array(BINS))


def close(actual, expected):
    scale = np.abs(expected).max()
    np.testing.assert_allclose(actual, expected, atol=1e-5 * scale)


def test_channels_and_beat_frequencies_follow_the_documented_sums():
    """One antenna pair and one sample at a time."""
    expected = np.empty(SHAPE, complex)
    for tx, rx, n in np.ndindex(3, 4, 32):
        turn = np.exp(-2j * np.pi * BINS[tx, rx] * n / 32)
        expected[tx, rx, :, n] = CUBE[tx, rx, :, n] * turn * CHANNELS[tx, rx]
    close(calibrate(jnp.array(CUBE), UNIT), expected)


@pytest.mark.parametrize("doppler_bin", [0.0, 3.0, -2.6])
def test_a_transmitters_lead_is_its_place_in_the_firing_order(doppler_bin):
    wave = noise(CASCADE.num_virtual)
    found = compensate_tdm(jnp.array(wave), jnp.float32(doppler_bin), CASCADE)
    for place, tx in enumerate(CASCADE.tx_firing_order):
        turn = np.exp(-2j * np.pi * doppler_bin * place / 12 / CASCADE.num_chirps)
        antennas = slice(16 * tx, 16 * tx + 16)
        close(found[antennas], wave[antennas] * turn)


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


def test_sizes_that_do_not_fit_are_refused():
    spectrum = jnp.zeros((12, 8, 32), complex)
    with pytest.raises(ValueError, match="3 tx x 4 rx x 15 range bins, expected 12"):
        subtract_leakage(spectrum, jnp.array(COUPLING[..., 1:]))
    with pytest.raises(ValueError, match="2 tx x 4 rx x 16"):
        subtract_leakage(spectrum, jnp.array(COUPLING[1:]))


@pytest.mark.usefixtures("as_a_user")
def test_snapshots_of_another_radar_are_refused():
    with pytest.raises(ValueError, match="24 values per snapshot, awr1843 has 3 tx x"):
        compensate_tdm(jnp.ones((5, 24), complex), jnp.zeros(5), RADAR)
