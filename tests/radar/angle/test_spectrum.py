"""Directions: known targets, the exact maximum, agreement with the whole spectrum."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import (
    RadarSpec,
    angle_spectrum,
    direction_sines,
    directions,
    spectrum_peaks,
    strongest_direction,
)

CHIP = RadarSpec.awr1843()
NARROW = RadarSpec.awr1843(design_frequency_hz=90e9)  # elements closer than half a wave
FLAT = RadarSpec.awr1642()
FULL = RadarSpec.awr1843(tx_positions=[(a, e) for e in range(4) for a in (0, 4)])
CASCADE = RadarSpec.cascade()
BINS = {CASCADE: {"num_azimuth": 128, "num_elevation": 64}}
RADARS = pytest.mark.parametrize(
    "radar",
    [CHIP, NARROW, FLAT, FULL, CASCADE],
    ids=["chip", "narrow", "flat", "full", "cascade"],
)


def sines_of(azimuth, elevation):
    return np.sin(azimuth) * np.cos(elevation), np.sin(elevation)


def plane_wave(radar, azimuth, elevation):
    phase = np.stack(sines_of(azimuth, elevation), -1) @ radar.virtual_positions.T
    wave = np.exp(2j * np.pi * radar.spacing_wavelengths * phase)
    return jnp.asarray(wave, jnp.complex64)


def random_directions(radar, count=300, widest=1.2):
    rng = np.random.default_rng(0)
    azimuth = rng.uniform(-widest, widest, count)
    return azimuth, rng.uniform(-0.5, 0.5, count) * radar.has_elevation


def noise(radar, count):
    rng = np.random.default_rng(1)
    parts = rng.normal(size=(2, count, radar.num_virtual))
    return jnp.asarray(parts[0] + 1j * parts[1], jnp.complex64)


def power_towards(snapshots, radar, u, w):
    """Power `[cell, direction]` of positions, by definition in float64."""
    positions = radar.virtual_positions
    shared = (positions == positions[:, None]).all(-1).sum(0)
    columns, rows = positions.T
    phase = np.multiply.outer(u, columns) + np.multiply.outer(w, rows)
    steering = np.exp(-2j * np.pi * radar.spacing_wavelengths * phase) / shared
    return np.abs(np.asarray(snapshots, np.complex128) @ steering.T) ** 2


@RADARS
def test_plane_wave_comes_back(radar):
    azimuth, elevation = random_directions(radar)
    found = directions(
        plane_wave(radar, azimuth, elevation), radar, **BINS.get(radar, {})
    )
    for sine, truth in zip(sines_of(*found), sines_of(azimuth, elevation), strict=True):
        np.testing.assert_allclose(sine, truth, atol=2e-3)


@RADARS
def test_agrees_with_the_whole_spectrum(radar):
    options = BINS.get(radar, {})
    cells = plane_wave(radar, *random_directions(radar)) + 0.3 * noise(radar, 300)
    fast = directions(cells, radar, **options)
    oracle = strongest_direction(angle_spectrum(cells, radar, **options), radar)
    u, w = direction_sines(radar, **options)
    du, dw = (a - b for a, b in zip(sines_of(*fast), sines_of(*oracle), strict=True))
    assert np.mean(np.abs(du) <= u[1] - u[0]) > 0.97  # else two peaks are as high
    if radar.has_elevation:
        assert np.mean(np.abs(dw) <= w[1] - w[0]) > 0.95


@pytest.mark.parametrize("radar", [CHIP, NARROW], ids=["chip", "narrow"])
def test_two_rows_reach_the_joint_maximum(radar):
    """No visible elevation of any azimuth bin holds more power than what is found."""
    cells = noise(radar, 200)
    azimuth, elevation = directions(cells, radar, interpolate=False)
    azimuth, elevation = np.float64(azimuth), np.float64(elevation)
    u = np.sin(azimuth) * np.cos(elevation)
    found = np.diagonal(power_towards(cells, radar, u, np.sin(elevation)))
    grid = np.meshgrid(direction_sines(radar)[0], np.linspace(-1, 1, 401))
    u, w = (sines.ravel() for sines in grid)
    visible = u**2 + w**2 <= 1
    best = power_towards(cells, radar, u[visible], w[visible]).max(1)
    assert (found >= best * (1 - 1e-4)).all()


@pytest.mark.parametrize("radar", [CHIP, CASCADE], ids=["chip", "cascade"])
def test_directions_do_not_depend_on_scale_or_on_the_batch(radar):
    options = BINS.get(radar, {})
    cells = noise(radar, 150)
    once = directions(cells, radar, **options)
    loud = directions(1e10 * cells.reshape(3, 50, -1), radar, **options)
    mapped = jax.vmap(lambda cell: directions(cell, radar, **options))(cells)
    for a, b, c in zip(once, loud, mapped, strict=True):
        np.testing.assert_allclose(a.reshape(3, 50), b, atol=2e-3)
        np.testing.assert_allclose(a, c, atol=2e-3)


@pytest.mark.parametrize(
    "radar", [CHIP, FLAT, CASCADE], ids=["chip", "flat", "cascade"]
)
def test_gradients_are_finite_even_in_empty_cells_and_at_the_edge(radar):
    options = BINS.get(radar, {})
    edge = plane_wave(radar, np.array([np.pi / 2, -np.pi / 2]), np.zeros(2))
    ahead = plane_wave(radar, np.array([0.3]), np.array([0.0]))
    cells = jnp.concatenate([noise(radar, 130), 0 * ahead, ahead, edge])

    def total(parts):
        azimuth, elevation = directions(jax.lax.complex(*parts), radar, **options)
        return azimuth.sum() + elevation.sum()

    for part in jax.jit(jax.grad(total))((cells.real, cells.imag)):
        assert jnp.isfinite(part).all() and jnp.abs(part).max() > 0


def test_gradient_is_the_slope():
    cell = plane_wave(CHIP, 0.3, 0.2) + 0.1 * noise(CHIP, 1)[0]

    def azimuth(real):
        return directions(jax.lax.complex(real, cell.imag), CHIP)[0]

    step = jnp.zeros(12).at[3].set(1e-2)
    slope = (azimuth(cell.real + step) - azimuth(cell.real - step)) / 2e-2
    np.testing.assert_allclose(jax.grad(azimuth)(cell.real)[3], slope, rtol=0.02)


def test_a_radar_mounted_upside_down_sees_the_same_directions():
    """Its antennas are turned by half a circle, so that phases lead the other way."""
    turned = RadarSpec.from_dict({"device": "awr1843", "upside_down": True})
    assert turned == RadarSpec.awr1843().upside_down() != RadarSpec.awr1843()
    cell = plane_wave(turned, 0.4, -0.2)
    np.testing.assert_allclose(directions(cell, turned), (0.4, -0.2), atol=0.02)
    swapped = directions(cell, RadarSpec.awr1843())
    np.testing.assert_allclose(swapped, (-0.4, 0.2), atol=0.02)


def test_two_targets_of_a_cell_are_both_found():
    cell = plane_wave(FULL, -0.3, 0.4) + 0.8j * plane_wave(FULL, -0.2, -0.4)
    spectrum = angle_spectrum(cell, FULL)
    peaks = spectrum_peaks(spectrum, FULL, count=4, within_db=6.0)
    np.testing.assert_array_equal(peaks.valid, [True, True, False, False])
    np.testing.assert_allclose(peaks.azimuth[:2], [-0.3, -0.2], atol=0.03)
    np.testing.assert_allclose(peaks.elevation[:2], [0.4, -0.4], atol=0.03)
    assert (jnp.diff(peaks.power) <= 0).all()


@RADARS
def test_first_peak_is_the_strongest_direction(radar):
    spectrum = angle_spectrum(noise(radar, 20), radar, **BINS.get(radar, {}))
    peaks = spectrum_peaks(spectrum, radar, count=3, within_db=10.0)
    azimuth, elevation = strongest_direction(spectrum, radar)
    np.testing.assert_array_equal(peaks.azimuth[:, 0], azimuth)
    np.testing.assert_array_equal(peaks.elevation[:, 0], elevation)
    assert peaks.valid[:, 0].all()


def test_a_cell_without_power_or_peaks_has_no_valid_ones():
    peaks = spectrum_peaks(jnp.zeros((32, 64)), CHIP, count=2)
    assert not peaks.valid.any() and jnp.isfinite(peaks.azimuth).all()
    smooth = angle_spectrum(plane_wave(CHIP, 0.1, 0.0), CHIP)
    assert spectrum_peaks(smooth, CHIP, count=2).valid.sum() == 1


def test_what_does_not_fit_is_refused():
    with pytest.raises(ValueError, match="7 rows and 86 columns: ask for more bins"):
        directions(jnp.zeros(192, complex), CASCADE)
    with pytest.raises(
        ValueError, match="8 values per snapshot, awr1843 has 3 tx x 4 rx"
    ):
        directions(jnp.zeros(8, complex), CHIP)
    with pytest.raises(ValueError, match="count=0, expected 1 to .* 32 x 64 bins"):
        spectrum_peaks(jnp.zeros((32, 64)), CHIP, count=0)
    with pytest.raises(ValueError, match="within_db=-3.0, expected 0 or more"):
        spectrum_peaks(jnp.zeros((32, 64)), CHIP, within_db=-3.0)
