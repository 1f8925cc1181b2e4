"""Capon and MUSIC: resolution beyond the beam, textbook formulas, gradients, errors."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import (
    RadarSpec,
    angle_spectrum,
    capon_spectrum,
    direction_sines,
    music_spectrum,
    smoothed_covariance,
    spectrum_peaks,
)

CHIP = RadarSpec.awr1843()
FLAT = RadarSpec.awr1642()
METHODS = pytest.mark.parametrize(
    "method",
    [capon_spectrum, lambda *a, **k: music_spectrum(*a, num_sources=2, **k)],
    ids=["capon", "music"],
)


def two_targets(radar, sines, *, snapshots, noise=0.03):
    """Equal targets at elevation 0; a single snapshot holds them 45 degrees apart."""
    rng = np.random.default_rng(3)
    columns = radar.virtual_positions[:, 0]
    turn = 2j * np.pi * radar.spacing_wavelengths
    waves = np.exp(turn * np.outer(sines, columns - columns.mean()))
    phase = rng.uniform(0, 2 * np.pi, (snapshots, 2))
    phase = phase if snapshots > 1 else np.array([[0, np.pi / 4]])
    grain = rng.normal(size=(2, snapshots, radar.num_virtual)) * noise
    cells = np.exp(1j * phase) @ waves + grain[0] + 1j * grain[1]
    return jnp.asarray(cells, jnp.complex64)


def peak_sines(power, radar, *, within_db=6.0):
    """Sines u of a spectrum's one or two strongest maxima."""
    peaks = spectrum_peaks(power[None], radar, count=2, within_db=within_db)
    return np.sort(np.sin(np.asarray(peaks.azimuth)[np.asarray(peaks.valid)]))


@METHODS
@pytest.mark.parametrize("snapshots", [1, 64])
def test_targets_within_a_beam_are_separated(method, snapshots):
    # The first null of eight elements lies 1 / (8 * 0.51) = 0.245 from the peak.
    sines = [-0.03, 0.13]
    cells = two_targets(FLAT, sines, snapshots=snapshots, noise=0.005)
    fourier = angle_spectrum(cells, FLAT, num_azimuth=256).mean(0)[0]
    assert len(peak_sines(fourier, FLAT)) == 1
    found = peak_sines(method(cells, FLAT), FLAT, within_db=20.0)
    np.testing.assert_allclose(found, sines, atol=0.01)


def reference_covariance(cells, size):
    """Forward-backward smoothing of full rows by its definition, in float64."""
    flip, total, count = np.eye(size)[::-1], 0, 0
    for row in np.asarray(cells, np.complex128):
        for start in range(len(row) - size + 1):
            x = row[start : start + size, None]
            total, count = total + x @ x.conj().T, count + 1
    mean = total / count
    return (mean + flip @ mean.conj() @ flip) / 2


def reference_steering(radar, size, num_azimuth):
    u, _ = direction_sines(radar, num_azimuth=num_azimuth)
    turn = 2j * np.pi * radar.spacing_wavelengths
    return np.exp(turn * np.outer(np.arange(size), u))


def test_capon_is_its_formula():
    cells = two_targets(FLAT, [-0.2, 0.3], snapshots=20)
    covariance = reference_covariance(cells, 6)
    np.testing.assert_allclose(
        smoothed_covariance(cells, FLAT, subarray=6), covariance, atol=1e-5
    )
    load = 0.01 * np.trace(covariance).real / 6
    inverse = np.linalg.inv(covariance + load * np.eye(6))
    a = reference_steering(FLAT, 6, 128)
    expected = 1 / np.einsum("iu,ij,ju->u", a.conj(), inverse, a).real
    found = capon_spectrum(cells, FLAT, num_azimuth=128, subarray=6, loading=0.01)
    np.testing.assert_allclose(found, expected, rtol=1e-3)


def test_music_is_its_formula():
    cells = two_targets(FLAT, [-0.2, 0.3], snapshots=20)
    _, vectors = np.linalg.eigh(reference_covariance(cells, 6))
    a = reference_steering(FLAT, 6, 128)
    share = (np.abs(vectors[:, :-2].conj().T @ a) ** 2).sum(0) / 6
    found = music_spectrum(cells, FLAT, num_sources=2, num_azimuth=128, subarray=6)
    np.testing.assert_allclose(found, 1 / (share + 1e-6), rtol=5e-3)


@pytest.mark.parametrize("radar", [CHIP, RadarSpec.cascade()], ids=["chip", "cascade"])
def test_the_longest_row_is_used_with_shared_positions_averaged(radar):
    cells = two_targets(radar, [-0.4, 0.3], snapshots=4)
    pseudo = music_spectrum(cells, radar, num_sources=2)
    found = peak_sines(pseudo, radar, within_db=20.0)
    np.testing.assert_allclose(found, [-0.4, 0.3], atol=0.01)


@METHODS
def test_vmap_equals_the_loop(method):
    cells = jnp.stack(
        [two_targets(CHIP, [0.1 * i, 0.5], snapshots=5) for i in range(3)]
    )
    batch = method(cells, CHIP, num_azimuth=64)
    mapped = jax.vmap(lambda cell: method(cell, CHIP, num_azimuth=64))(cells)
    for i, cell in enumerate(cells):
        alone = method(cell, CHIP, num_azimuth=64)
        np.testing.assert_allclose(batch[i], alone, rtol=1e-2)
        np.testing.assert_allclose(mapped[i], alone, rtol=1e-2)


@METHODS
def test_gradients_are_finite_without_noise_and_without_signal(method):
    cells = two_targets(FLAT, [0.0, 0.3], snapshots=1, noise=0.0)
    for snapshots in (cells, 0 * cells):

        def total(parts):
            return jnp.log(method(jax.lax.complex(*parts), FLAT)).sum()

        for part in jax.grad(total)((snapshots.real, snapshots.imag)):
            assert jnp.isfinite(part).all()


@METHODS
def test_gradient_is_the_slope(method):
    cells = two_targets(FLAT, [0.0, 0.4], snapshots=6, noise=0.3)

    def total(real):
        power = method(jax.lax.complex(real, cells.imag), FLAT, num_azimuth=32)
        return jnp.log(power).sum()

    step = jnp.zeros(cells.shape).at[2, 3].set(3e-3)
    slope = (total(cells.real + step) - total(cells.real - step)) / 6e-3
    np.testing.assert_allclose(jax.grad(total)(cells.real)[2, 3], slope, rtol=0.03)


def test_what_cannot_be_resolved_is_refused():
    cells = jnp.ones((3, 12), complex)
    with pytest.raises(ValueError, match="subarray=9, expected 2 to 8, .* awr1843"):
        capon_spectrum(cells, CHIP, subarray=9)
    with pytest.raises(ValueError, match="num_sources=5, expected 1 to 4: a subarray"):
        music_spectrum(cells, CHIP, num_sources=5, subarray=5)
    with pytest.raises(ValueError, match="num_sources=0, expected 1 to 4"):
        music_spectrum(cells, CHIP, num_sources=0)
    with pytest.raises(ValueError, match="8 values per snapshot, awr1843 has 3 tx"):
        capon_spectrum(jnp.ones((3, 8), complex), CHIP)
