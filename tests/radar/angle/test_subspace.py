"""Capon and MUSIC: resolution beyond the beam, textbook formulas, gradients, errors."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import angle_spectrum, direction_sines
from jradar.radar.angle.spectrum import spectrum_peaks
from jradar.radar.angle.subspace import (
    capon_spectrum,
    music_spectrum,
    smoothed_covariance,
)
from tests.radar.targets import CASCADE, FLAT, SMALL, noise, single, waves_towards

METHODS = pytest.mark.parametrize(
    "method",
    [capon_spectrum, functools.partial(music_spectrum, num_sources=2)],
    ids=["capon", "music"],
)


def two_targets(radar, sines, *, snapshots, grain=0.03):
    """Equal targets at elevation 0; a single snapshot holds them 45 degrees apart."""
    middle = radar.virtual_positions[:, 0].mean() * radar.spacing_wavelengths
    waves = waves_towards(radar, sines, [0, 0], -2 * np.pi * middle * np.c_[sines])
    phase = np.random.default_rng(3).uniform(0, 2 * np.pi, (snapshots, 2))
    phase = phase if snapshots > 1 else np.array([[0, np.pi / 4]])
    cells = np.exp(1j * phase) @ waves
    return single(cells + grain * noise(*cells.shape, seed=3))


def peak_sines(power, radar, *, within_db=6.0):
    """Sines u of a spectrum's one or two strongest maxima."""
    peaks = spectrum_peaks(power[None], radar, count=2)
    shown = peaks.power >= peaks.power[0] * 10 ** (-within_db / 10)
    return np.sort(np.sin(np.asarray(peaks.azimuth)[np.asarray(shown)]))


@METHODS
@pytest.mark.parametrize("snapshots", [1, 64])
def test_targets_within_a_beam_are_separated(method, snapshots):
    # The first null of eight elements lies 1 / (8 * 0.51) = 0.245 from the peak.
    sines = [-0.03, 0.13]
    cells = two_targets(FLAT, sines, snapshots=snapshots, grain=0.005)
    fourier = angle_spectrum(cells, FLAT, num_azimuth=256).mean(0)[0]
    assert len(peak_sines(fourier, FLAT)) == 1
    found = peak_sines(method(cells, FLAT), FLAT, within_db=20.0)
    np.testing.assert_allclose(found, sines, atol=0.01)


def test_both_are_their_formulas():
    """Forward-backward smoothing of full rows by its definition, in float64."""
    cells = two_targets(FLAT, [-0.2, 0.3], snapshots=20)
    parts = np.stack([np.complex128(cells)[:, k : k + 5] for k in range(4)], 1)
    mean = np.einsum("nki,nkj->ij", parts, parts.conj()) / parts[..., 0].size
    covariance = (mean + mean[::-1, ::-1].conj()) / 2
    smoothed = smoothed_covariance(cells, FLAT)
    np.testing.assert_allclose(smoothed, covariance, atol=1e-5)

    u, _ = direction_sines(FLAT, num_azimuth=128)
    turn = 2j * np.pi * FLAT.spacing_wavelengths
    a = np.exp(turn * np.outer(np.arange(5), u))
    load = 1e-3 * np.trace(covariance).real / 5
    inverse = np.linalg.inv(covariance + load * np.eye(5))
    expected = 1 / np.einsum("iu,ij,ju->u", a.conj(), inverse, a).real
    found = capon_spectrum(cells, FLAT, num_azimuth=128)
    np.testing.assert_allclose(found, expected, rtol=1e-3)

    _, vectors = np.linalg.eigh(covariance)
    share = (np.abs(vectors[:, :-2].conj().T @ a) ** 2).sum(0) / 5
    found = music_spectrum(cells, FLAT, num_sources=2, num_azimuth=128)
    np.testing.assert_allclose(found, 1 / (share + 1e-6), rtol=5e-3)


@pytest.mark.parametrize("radar", [SMALL, CASCADE], ids=["chip", "cascade"])
def test_the_longest_row_is_used_with_shared_positions_averaged(radar):
    cells = two_targets(radar, [-0.4, 0.3], snapshots=4)
    pseudo = music_spectrum(cells, radar, num_sources=2)
    found = peak_sines(pseudo, radar, within_db=20.0)
    np.testing.assert_allclose(found, [-0.4, 0.3], atol=0.01)


@METHODS
def test_gradients_are_slopes_and_finite_without_noise_and_without_signal(method):
    cells = two_targets(FLAT, [0.0, 0.4], snapshots=6, grain=0.3)
    silent = two_targets(FLAT, [0.0, 0.3], snapshots=6, grain=0.0)

    @jax.jit
    def total(real, imag):
        power = method(jax.lax.complex(real, imag), FLAT, num_azimuth=32)
        return jnp.log(power).sum()

    slopes = jax.jit(jax.grad(total, (0, 1)))
    for snapshots in (silent, 0 * silent):
        assert np.isfinite(slopes(snapshots.real, snapshots.imag)).all()
    slope, _ = slopes(cells.real, cells.imag)
    steepest = slope / jnp.linalg.norm(slope)
    ends = (total(cells.real + k * steepest, cells.imag) for k in (3e-3, -3e-3))
    difference = np.subtract(*ends) / 6e-3
    np.testing.assert_allclose(jnp.linalg.norm(slope), difference, rtol=0.03)


def test_what_cannot_be_resolved_is_refused():
    cells = jnp.ones((3, 12), complex)
    with pytest.raises(ValueError, match="subarray=9, expected 2 to 8, .* awr1843"):
        smoothed_covariance(cells, SMALL, subarray=9)
    with pytest.raises(ValueError, match="num_sources=5, expected 1 to 4: a subarray"):
        music_spectrum(cells, SMALL, num_sources=5)
    with pytest.raises(ValueError, match="num_sources=0, expected 1 to 4"):
        music_spectrum(cells, SMALL, num_sources=0)
    with pytest.raises(ValueError, match="8 values per snapshot, awr1843 has 3 tx"):
        capon_spectrum(jnp.ones((3, 8), complex), SMALL)
