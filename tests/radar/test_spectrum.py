"""Spectra: NumPy's FFT, a tone's peak, noise, static removal."""

import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import RadarSpec, noise_statistics, power_map, range_doppler
from jradar.radar.spectrum import window
from tests.radar.targets import noise, single


def tone(doppler_bin, range_bin, chirps=16, samples=32):
    slow = np.exp(2j * np.pi * doppler_bin * np.arange(chirps) / chirps)
    fast = np.exp(2j * np.pi * range_bin * np.arange(samples) / samples)
    return single(np.outer(slow, fast)[None, None])


@pytest.mark.parametrize("kind", ["none", "hann", "hamming", "blackman"])
def test_centred_tone_peaks_at_its_amplitude(kind):
    windows = {"range_window": kind, "doppler_window": kind}
    spectrum = np.abs(range_doppler(3 * tone(-5, 20), **windows)[0][0])
    row, column = np.unravel_index(spectrum.argmax(), spectrum.shape)
    assert (row - 8, column) == (-5, 20)
    assert spectrum[row, column] == pytest.approx(3, rel=1e-5)
    assert window(kind, 1).tolist() == [1.0]  # one chirp has a window too
    with pytest.raises(ValueError, match="'kaiser', expected one of"):
        range_doppler(tone(0, 0), range_window="kaiser")


@pytest.mark.parametrize(("chirps", "batch"), [(8, (2,)), (7, ())])
def test_spectrum_is_the_shifted_fft_of_the_windowed_cube(chirps, batch):
    cube = noise(*batch, 2, 3, chirps, 16)
    weight = np.outer(window("hann", chirps), window("blackman", 16))
    expected = np.fft.fftshift(np.fft.fft2(cube * weight), axes=-2)
    expected = expected.reshape(*batch, 6, chirps, 16)
    spectrum, power = range_doppler(single(cube), range_window="blackman")
    np.testing.assert_allclose(spectrum, expected, atol=1e-6)
    np.testing.assert_allclose(power, (abs(expected) ** 2).sum(-3), atol=1e-6)
    alone = power_map(single(cube), range_window="blackman")
    np.testing.assert_allclose(alone, power, rtol=1e-5)


def test_noise_has_the_power_level_and_spread_that_were_simulated():
    radar = RadarSpec.awr1642(num_chirps=64, num_samples=128)
    quiet = 7 / 2**0.5 * noise(*radar.cube_shape)  # 7 counts in each sample
    power = power_map(jnp.asarray(quiet))
    gains = [(window("hann", count) ** 2).sum() for count in (64, 128)]
    expected = 7**2 * radar.num_virtual * np.prod(gains)
    np.testing.assert_allclose(np.mean(power), expected, rtol=0.03)
    found = noise_statistics(power, radar)
    assert found.counts_per_sample == pytest.approx(7, rel=0.02)
    assert found.spread_db == pytest.approx(found.pure_noise_spread_db, rel=0.05)
    echo = 2000 * np.exp(0.4j * np.pi * np.arange(radar.num_samples))
    loud = noise_statistics(power_map(jnp.asarray(quiet + echo)), radar)
    assert loud.floor_db == pytest.approx(found.floor_db, abs=0.3)
    silent = noise_statistics(np.zeros((64, 128)), radar)
    assert np.isfinite(silent).all() and silent.counts_per_sample == 0


def test_removing_the_static_leaves_the_movers():
    power = np.asarray(power_map(100 * tone(0, 8) + tone(4, 20), remove_static=True))
    assert np.unravel_index(power.argmax(), power.shape) == (8 + 4, 20)
    assert power[:, 8].max() < 1e-6
