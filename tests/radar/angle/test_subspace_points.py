"""Points by Capon and MUSIC: both angles, and two targets of a cell within a beam."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import (
    PointSpec,
    Scatterers,
    radar_points,
    simulate_cube,
    subspace_peaks,
)
from tests.radar.targets import CASCADE, FLAT, SMALL, spherical, target

METHODS = pytest.mark.parametrize("method", ["capon", "music"])
ONE = PointSpec(detector="ca", capacity=1)
ELEMENTS = 5  # of a subarray: two thirds of the row of 8
LOADING = 1e-3
PLACES = [(-55, 4), (-30, -14), (-8, 11), (0, 0), (12, -5), (37, 9), (52, -8)]


def direction(azimuth_deg, elevation_deg):
    az, el = np.radians([azimuth_deg, elevation_deg])
    return np.array([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)])


def snapshot_of(cube, radar):
    """Values of the virtual array in the strongest cell of targets that stand still."""
    windows = (
        0.5 - 0.5 * np.cos(2 * np.pi * np.arange(size) / size)
        for size in (radar.num_chirps, radar.num_samples)
    )
    doppler, sample = windows
    weighted = np.asarray(cube, np.complex128) * doppler[:, None] * sample
    spectrum = np.fft.fft2(weighted).reshape(radar.num_virtual, *cube.shape[2:])
    power = (np.abs(spectrum) ** 2).sum(0)
    return spectrum[:, *np.unravel_index(power.argmax(), power.shape)]


def reference(cube, radar, method):
    """Azimuth and elevation in radians from the textbook's formulas, in float64."""
    values, columns = snapshot_of(cube, radar), radar.virtual_positions[:, 0]
    rows = [radar.virtual_positions[:, 1] == row for row in (0, 1)]
    row = values[rows[0]][np.argsort(columns[rows[0]])]
    covariance = np.zeros((ELEMENTS, ELEMENTS), complex)
    for start in range(len(row) - ELEMENTS + 1):
        part = row[start : start + ELEMENTS]
        for x in (part, part[::-1].conj()):
            covariance += np.outer(x, x.conj())
    covariance *= ELEMENTS / np.trace(covariance).real
    u = np.linspace(-0.95, 0.95, 20001)
    spacing = 2j * np.pi * radar.spacing_wavelengths
    a = np.exp(spacing * np.outer(np.arange(ELEMENTS), u))
    if method == "capon":
        inverse = np.linalg.inv(covariance + LOADING * np.eye(ELEMENTS))
        height = -np.einsum("iu,ij,ju->u", a.conj(), inverse, a).real
    else:
        noise = np.linalg.eigh(covariance)[1][:, :-2]
        height = -(np.abs(noise.conj().T @ a) ** 2).sum(0)
    inner = np.flatnonzero((height[1:-1] > height[:-2]) & (height[1:-1] > height[2:]))
    peaks = u[1 + inner]
    beams = np.abs(row @ np.exp(-spacing * np.outer(np.arange(len(row)), peaks)))
    score = height[1 + inner] if method == "capon" else beams
    u = peaks[score.argmax()]
    lower, upper = (values[row] @ np.exp(-spacing * columns[row] * u) for row in rows)
    turn = 2 * np.pi * radar.row_spacing_wavelengths
    elevation = np.arcsin(np.angle(upper * lower.conj()) / turn)
    return np.arcsin(u / np.cos(elevation)), elevation


@METHODS
@pytest.mark.parametrize("place", PLACES, ids=str)
def test_points_have_the_azimuth_and_elevation_of_the_target(method, place):
    truth = target(4.0, *place, 0.0)
    cube = simulate_cube(jax.random.key(0), truth, SMALL, noise_power=1.0)
    points = dataclasses.replace(ONE, angles=method)
    found = spherical(radar_points(cube, SMALL, points=points).xyz)
    angles = np.array([found[1][0], found[2][0]])
    np.testing.assert_allclose(np.degrees(angles), place, atol=0.4)
    expected = reference(cube, SMALL, method)
    np.testing.assert_allclose(np.degrees(angles), np.degrees(expected), atol=0.2)


def two(places, radar, phase):
    """A cube of two equal targets in one cell, `phase` radians apart in the middle."""
    middle = (radar.num_samples - 1) / 2 / radar.sample_rate_hz
    middle_hz = radar.start_frequency_hz + radar.slope_hz_per_s * (
        radar.adc_start_time_s + middle
    )
    farther = phase / (4 * np.pi) * 299_792_458.0 / middle_hz
    distances = np.array([4.0, 4.0 + farther])
    xyz = distances[:, None] * np.stack([direction(*place) for place in places])
    truth = Scatterers(
        xyz=jnp.asarray(xyz, jnp.float32),
        velocity=jnp.zeros(2),
        amplitude=jnp.full(2, 100.0),
    )
    return simulate_cube(jax.random.key(0), truth, radar, noise_power=0.01)


@METHODS
def test_two_targets_of_a_cell_within_a_beam_are_two_points(method):
    # 8 elements of half a wavelength resolve 0.245 in the sine, 14 degrees.
    places = [(-4.0, -1.0), (4.0, 5.0)]
    cube = two(places, SMALL, 1.6)
    by_fft = dataclasses.replace(ONE, peaks=2, group_peaks=True, capacity=2)
    worst = np.abs(found_places(cube, by_fft) - places).max()
    assert worst > 4
    found = found_places(cube, dataclasses.replace(by_fft, angles=method))
    np.testing.assert_allclose(found, places, atol=0.3)


def found_places(cube, points):
    """Azimuth and elevation in degrees of two points, the rightmost first."""
    cloud = radar_points(cube, SMALL, points=points)
    found = np.degrees(spherical(cloud.xyz[:2])[1:]).T
    found = np.where(np.asarray(cloud.valid)[:, None], found, 90.0)
    return found[found[:, 0].argsort()]


@pytest.mark.parametrize("changes", [{"angles": "capon"}, {"sources": 0}], ids=str)
def test_one_target_of_a_cell_stays_one_point(changes):
    cube = simulate_cube(
        jax.random.key(1), target(4.0, 10, 5, 0.0), SMALL, noise_power=1.0
    )
    options = {"angles": "music", "peaks": 2, "group_peaks": True, "capacity": 2}
    points = dataclasses.replace(ONE, **(options | changes))
    cloud = radar_points(cube, SMALL, points=points)
    assert cloud.valid.tolist() == [True, False]
    azimuth, elevation = spherical(cloud.xyz[:1])[1:]
    np.testing.assert_allclose(np.degrees([azimuth[0], elevation[0]]), [10, 5], atol=1)


@METHODS
@pytest.mark.parametrize("radar", [FLAT, CASCADE], ids=["one row", "four rows"])
def test_peaks_are_plane_waves_of_their_power(method, radar):
    places = np.array([[-0.25, 0.1], [0.3, -0.05]]) * [1, radar.has_elevation]
    columns, rows = radar.virtual_positions.T
    turns = places[:, :1] * columns * radar.spacing_wavelengths
    turns = turns + places[:, 1:] * rows * radar.row_spacing_wavelengths
    waves = np.exp(2j * np.pi * (turns + [[0.0], [0.2]])) * [[1.0], [0.8]]
    cells = jnp.asarray(waves.sum(0), jnp.complex64)[None, None]
    peaks = subspace_peaks(cells, radar, method=method)
    assert peaks.valid.shape == (1, 1, 2) and peaks.valid.all()
    w = np.sin(peaks.elevation[0, 0])
    u = np.sin(peaks.azimuth[0, 0]) * np.cos(peaks.elevation[0, 0])
    np.testing.assert_allclose(np.stack([u, w], -1), places, atol=0.01)
    np.testing.assert_allclose(peaks.power[0, 0], [1.0, 0.64], rtol=0.1)


def test_what_has_no_peaks_is_refused_or_not_valid():
    wave = jnp.exp(0.3j * SMALL.virtual_positions.sum(1))
    cells = jnp.stack([jnp.zeros(12), wave]).astype("complex64")
    flips = {"flip_azimuth": True, "flip_elevation": True}
    peaks = subspace_peaks(cells, SMALL, method="music", num_sources=1, **flips)
    assert peaks.valid.tolist() == [[False, False], [True, False]]
    assert jnp.isfinite(peaks.azimuth).all()
    assert peaks.azimuth[1, 0] < -0.05 and peaks.elevation[1, 0] < -0.05
    with pytest.raises(ValueError, match="method='esprit', expected one of"):
        subspace_peaks(jnp.zeros((3, 12), complex), SMALL, method="esprit")
    with pytest.raises(ValueError, match="count=0, expected 1 to 256 targets"):
        subspace_peaks(jnp.zeros((3, 12), complex), SMALL, method="capon", count=0)
    with pytest.raises(ValueError, match="8 values per snapshot, awr1843 has"):
        subspace_peaks(jnp.zeros((3, 8), complex), SMALL, method="capon")


@METHODS
@pytest.mark.parametrize(("weaker_db", "valid"), [(4.0, True), (8.0, False)])
def test_a_peak_counts_down_to_6_db_below_the_strongest(method, weaker_db, valid):
    """Two plane waves far apart, without noise: powers are known."""
    columns, rows = SMALL.virtual_positions.T
    phases = np.random.default_rng(0).uniform(size=(8, 2))
    weak = 10 ** (-weaker_db / 20)
    waves = [
        amplitude * np.exp(2j * np.pi * (columns * spacing * u + phase[:, None]))
        for amplitude, u, phase in zip((1.0, weak), (-0.4, 0.5), phases.T, strict=True)
        for spacing in (SMALL.spacing_wavelengths,)
    ]
    snapshot = jnp.asarray(sum(waves), jnp.complex64)
    found = subspace_peaks(snapshot, SMALL, method=method)
    u = np.sin(found.azimuth) * np.cos(found.elevation)
    np.testing.assert_allclose(u[:, 0], -0.4, atol=0.05)
    if method == "music":  # Capon's spectrum itself is not that of the powers
        np.testing.assert_array_equal(found.valid[:, 1], valid)
    assert valid or not found.valid[:, 1].any()
