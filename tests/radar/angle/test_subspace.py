"""Capon and MUSIC: formulas, directions, points, resolution beyond the beam, errors."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import PointSpec, angle_spectrum, directions
from jradar.radar.angle import subspace
from jradar.radar.angle.spectrum import direction_sines, spectrum_peaks
from jradar.radar.angle.subspace import (
    capon_spectrum,
    music_spectrum,
    smoothed_covariance,
    subspace_directions,
)
from jradar.radar.angle.subspace_peaks import subspace_peaks
from tests.radar.targets import (
    CASCADE,
    FLAT,
    LIGHT,
    SMALL,
    cloud_of,
    degrees,
    noise,
    plane_wave,
    simulate,
    sines,
    single,
    target,
    targets,
    waves_towards,
)

METHODS = pytest.mark.parametrize("method", ["capon", "music"])
MUSIC = functools.partial(music_spectrum, num_sources=2)
SPECTRA = {"capon": capon_spectrum, "music": MUSIC}
ONE = PointSpec(detector="ca", capacity=1)
TWO = dataclasses.replace(ONE, peaks=2, group_peaks=True, capacity=2)


def waves_of(radar, azimuth_sines, count, *, grain, phase=None):
    """Snapshots of equal targets at elevation 0, of random phases in the middle."""
    middle = radar.virtual_positions[:, 0].mean() * radar.spacing_wavelengths
    u = np.reshape(azimuth_sines, (-1, 1))
    waves = waves_towards(radar, u[:, 0], 0 * u[:, 0], -2 * np.pi * middle * u)
    if phase is None:
        phase = np.random.default_rng(3).uniform(0, 2 * np.pi, (count, len(u)))
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
    places = [-0.03, 0.13]
    phase = np.array([[0, np.pi / 4]]) if snapshots == 1 else None
    cells = waves_of(FLAT, places, snapshots, grain=0.005, phase=phase)
    fourier = angle_spectrum(cells, FLAT, num_azimuth=256).mean(0)[0]
    assert len(peak_sines(fourier, FLAT)) == 1
    found = peak_sines(SPECTRA[method](cells, FLAT), FLAT, within_db=20.0)
    np.testing.assert_allclose(found, places, atol=0.01)


def test_both_are_their_formulas():
    """Forward-backward smoothing of full rows by its definition, in float64."""
    cells = waves_of(FLAT, [-0.2, 0.3], 20, grain=0.03)
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
    cells = waves_of(radar, [-0.4, 0.3], 4, grain=0.03)
    pseudo = music_spectrum(cells, radar, num_sources=2)
    found = peak_sines(pseudo, radar, within_db=20.0)
    np.testing.assert_allclose(found, [-0.4, 0.3], atol=0.01)


@METHODS
def test_gradients_are_slopes_and_finite_without_noise_and_without_signal(method):
    cells = waves_of(FLAT, [0.0, 0.4], 6, grain=0.3)
    silent = waves_of(FLAT, [0.0, 0.3], 6, grain=0.0)

    @jax.jit
    def total(real, imag):
        power = SPECTRA[method](jax.lax.complex(real, imag), FLAT, num_azimuth=32)
        return jnp.log(power).sum()

    slopes = jax.jit(jax.grad(total, (0, 1)))
    for snapshots in (silent, 0 * silent):
        assert np.isfinite(slopes(snapshots.real, snapshots.imag)).all()
    slope, _ = slopes(cells.real, cells.imag)
    steepest = slope / jnp.linalg.norm(slope)
    ends = (total(cells.real + k * steepest, cells.imag) for k in (3e-3, -3e-3))
    difference = np.subtract(*ends) / 6e-3
    np.testing.assert_allclose(jnp.linalg.norm(slope), difference, rtol=0.03)


@METHODS
def test_one_target_is_found_where_it_is_whatever_the_block(method, monkeypatch):
    monkeypatch.setattr(subspace, "BLOCK", 2)  # of five cells, which no other test has
    angles = np.radians([[-50, -20, 0, 8, 35], [3, -12, 0, 15, -8]])
    cells = single(plane_wave(SMALL, *angles))
    found = subspace_directions(cells, SMALL, method=method)
    np.testing.assert_allclose(found[0], angles[0], atol=np.radians(0.3))
    np.testing.assert_allclose(found[1], angles[1], atol=np.radians(0.5))
    batch = subspace_directions(cells[:, None], SMALL, method=method)
    np.testing.assert_allclose(batch[0][:, 0], found[0], atol=1e-5)


def test_of_two_targets_in_a_beam_one_is_found_that_the_spectrum_merges():
    true = np.array([-0.12, 0.12])
    cells = waves_of(SMALL, true, 16, grain=0.007)

    def median_error(find):
        u = np.sin(np.asarray(find(cells, SMALL)[0]))
        return np.median(np.abs(u[:, None] - true).min(1))

    finders = (functools.partial(subspace_directions, method=m) for m in SPECTRA)
    assert max(map(median_error, finders)) < 0.02 < 0.04 < median_error(directions)


@METHODS
@pytest.mark.parametrize("points", [ONE, TWO], ids=["one peak", "two peaks"])
def test_one_target_of_a_cell_is_one_point(points, method):
    cloud = cloud_of(
        simulate(target(4.0, -30, -14, 0.0), seed=1),
        points=dataclasses.replace(points, angles=method, sources=1),
    )
    assert cloud.valid.tolist() == [True, False][: points.capacity]
    np.testing.assert_allclose(degrees(cloud), [[-30, -14]], atol=0.4)


@pytest.mark.slow
@METHODS
def test_two_targets_of_a_cell_within_a_beam_are_two_points(method):
    """Equal ones, 1.6 radians apart in the middle, less than the beam's 14 degrees."""
    places = [(-4.0, -1.0), (4.0, 5.0)]
    middle_s = SMALL.adc_start_time_s + 63 / 2 / SMALL.sample_rate_hz
    middle_hz = SMALL.start_frequency_hz + SMALL.slope_hz_per_s * middle_s
    farther = 1.6 / (4 * np.pi) * LIGHT / middle_hz
    truth = targets((4.0, *places[0], 0.0), (4.0 + farther, *places[1], 0.0))
    cube = simulate(truth, noise_power=0.01)

    def found(points):
        """Azimuth and elevation in degrees of two points, the rightmost first."""
        cloud = cloud_of(cube, points=points)
        angles = np.where(cloud.valid[:, None], degrees(cloud, 2), 90.0)
        return angles[angles[:, 0].argsort()]

    assert np.abs(found(TWO) - places).max() > 4  # by the FFT
    resolved = found(dataclasses.replace(TWO, angles=method))
    np.testing.assert_allclose(resolved, places, atol=0.3)


@METHODS
@pytest.mark.parametrize("radar", [FLAT, CASCADE], ids=["one row", "four rows"])
def test_peaks_are_plane_waves_of_their_power_down_to_6_db(method, radar):
    places = np.array([[-0.25, 0.1], [0.28, -0.05]]) * [1, radar.has_elevation]
    waves = waves_towards(radar, *places.T, [[0.0], [0.4 * np.pi]])
    weaker = 10 ** (-np.array([1, 5, 8]) / 20)  # amplitudes, 1, 5 and 8 dB down
    cells = single(waves[0] + weaker[:, None] * waves[1])
    peaks = subspace_peaks(cells, radar, method=method)
    power, valid = np.asarray(peaks.power), np.asarray(peaks.valid)
    assert valid.shape == (3, 2) and valid[:, 0].all()
    for i in range(2 if method == "music" else 1):  # Capon's heights differ more
        assert valid[i, 1]
        found = np.stack(sines(peaks.azimuth[i], peaks.elevation[i]), -1)
        np.testing.assert_allclose(found, places, atol=0.01)
        np.testing.assert_allclose(power[i], [1.0, weaker[i] ** 2], rtol=0.1)
    assert not valid[2, 1]


def test_a_cell_of_nothing_has_no_peaks():
    wave = np.exp(0.3j * SMALL.virtual_positions.sum(1))
    cells = single(np.stack([0 * wave, wave]))
    peaks = subspace_peaks(cells, SMALL, method="music", num_sources=1)
    assert peaks.valid.tolist() == [[False, False], [True, False]]
    assert np.isfinite(peaks.azimuth).all()
    assert peaks.azimuth[1, 0] > 0.05 and peaks.elevation[1, 0] > 0.05


@pytest.mark.parametrize(
    ("function", "antennas", "options", "message"),
    [
        (music_spectrum, 12, {"num_sources": 5}, "num_sources=5, expected 1 to 4: a s"),
        (music_spectrum, 12, {"num_sources": 0}, "num_sources=0, expected 1 to 4"),
        (capon_spectrum, 8, {}, "8 values per snapshot, awr1843 has 3 tx"),
        (subspace_peaks, 8, {"method": "capon"}, "8 values per snapshot, awr1843 has"),
        (subspace_peaks, 12, {"method": "esprit"}, "method='esprit', expected one of"),
        (
            functools.partial(subspace_peaks, method="capon"),
            12,
            {"count": 0},
            "count=0, expected 1 to 256 targ",
        ),
    ],
)
def test_what_cannot_be_resolved_is_refused(function, antennas, options, message):
    with pytest.raises(ValueError, match=message):
        function(jnp.ones((3, antennas), complex), **({"radar": SMALL} | options))
