"""Spectra: NumPy's FFT, a tone's peak, noise power, static removal, gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from jradar.radar import (
    power_map,
    range_doppler,
    window,
)


def tone(chirps, samples, doppler_bin, range_bin):
    slow = np.exp(2j * np.pi * doppler_bin * np.arange(chirps) / chirps)
    fast = np.exp(2j * np.pi * range_bin * np.arange(samples) / samples)
    return jnp.asarray(np.outer(slow, fast)[None, None], jnp.complex64)


@pytest.mark.parametrize("kind", ["none", "hann", "hamming", "blackman"])
def test_centred_tone_peaks_at_its_amplitude(kind):
    spectrum, _ = range_doppler(
        3 * tone(16, 32, -5, 20), range_window=kind, doppler_window=kind
    )
    row, column = divmod(int(jnp.abs(spectrum[0]).argmax()), 32)
    assert (row - 8, column) == (-5, 20)
    np.testing.assert_allclose(jnp.abs(spectrum[0, row, column]), 3, rtol=1e-5)


def test_noise_power_in_a_cell_follows_from_the_window():
    real, imaginary = jax.random.normal(jax.random.key(0), (2, 3, 4, 64, 64))
    power = power_map(jax.lax.complex(real, imaginary), doppler_window="none")
    gains = [(window(kind, 64) ** 2).sum() for kind in ("hann", "none")]
    expected = 2 * 12 * gains[0] * gains[1]
    np.testing.assert_allclose(power.mean(), expected, rtol=0.03)


@pytest.mark.parametrize("chirps", [8, 7])
@pytest.mark.parametrize("batch", [(), (2,)])
def test_spectrum_is_the_shifted_fft_of_the_windowed_cube(chirps, batch):
    rng = np.random.default_rng(0)
    cube = rng.normal(size=(*batch, 2, 3, chirps, 16, 2)) @ [1, 1j]
    weight = np.outer(window("hann", chirps), window("blackman", 16))
    expected = np.fft.fftshift(np.fft.fft2(cube * weight), axes=-2)
    expected = expected.reshape(*batch, 6, chirps, 16)
    cube = jnp.asarray(cube, jnp.complex64)
    spectrum, power = range_doppler(cube, range_window="blackman")
    np.testing.assert_allclose(spectrum, expected, atol=1e-6)
    np.testing.assert_allclose(power, (abs(expected) ** 2).sum(-3), atol=1e-6)
    np.testing.assert_allclose(
        power_map(cube, range_window="blackman"), power, rtol=1e-5
    )


def test_removing_the_static_leaves_the_movers():
    cube = 100 * tone(16, 32, 0, 8) + tone(16, 32, 4, 20)
    power = power_map(cube, remove_static=True)
    assert divmod(int(power.argmax()), 32) == (8 + 4, 20)
    assert power[:, 8].max() < 1e-6


def test_one_chirp_has_a_window_too():
    assert window("hann", 1).tolist() == [1.0]
    assert np.isfinite(power_map(tone(1, 32, 0, 5))).all()


def test_unknown_window_is_named():
    with pytest.raises(ValueError, match="'kaiser', expected one of"):
        range_doppler(tone(4, 4, 0, 0), range_window="kaiser")


def test_gradient_is_the_numerical_one():
    parts = jax.random.normal(jax.random.key(0), (2, 1, 2, 4, 8))
    check_grads(
        jax.jit(lambda p: power_map(jax.lax.complex(p[0], p[1]))),
        (parts,),
        order=1,
        modes=["rev"],
        atol=2e-2,
        rtol=2e-2,
    )
