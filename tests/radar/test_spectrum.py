"""Spectra: NumPy's FFT, a tone's peak, noise power, static removal, gradients."""

import jax
import numpy as np
import pytest
from jax.test_util import check_grads

from jradar.radar import power_map, range_doppler, window
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


def test_noise_power_in_a_cell_follows_from_the_window():
    power = power_map(single(noise(3, 4, 64, 64)), doppler_window="none")
    gains = [(window(kind, 64) ** 2).sum() for kind in ("hann", "none")]
    expected = 2 * 12 * gains[0] * gains[1]
    np.testing.assert_allclose(np.mean(power), expected, rtol=0.03)


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


def test_removing_the_static_leaves_the_movers():
    power = np.asarray(power_map(100 * tone(0, 8) + tone(4, 20), remove_static=True))
    assert np.unravel_index(power.argmax(), power.shape) == (8 + 4, 20)
    assert power[:, 8].max() < 1e-6


def test_one_chirp_has_a_window_too():
    assert window("hann", 1).tolist() == [1.0]
    assert np.isfinite(power_map(tone(0, 5, chirps=1))).all()


def test_unknown_window_is_named():
    with pytest.raises(ValueError, match="'kaiser', expected one of"):
        range_doppler(tone(0, 0), range_window="kaiser")


def test_gradient_is_the_numerical_one():
    parts = jax.random.normal(jax.random.key(0), (2, 1, 2, 4, 8))
    power = jax.jit(lambda p: power_map(jax.lax.complex(p[0], p[1])))
    check_grads(power, (parts,), order=1, modes=["rev"], atol=2e-2, rtol=2e-2)
