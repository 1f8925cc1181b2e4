"""Directions: known targets, the exact maximum, agreement with the whole spectrum."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import RadarSpec, angle_spectrum, directions
from jradar.radar.angle import direction
from jradar.radar.angle.spectrum import direction_sines, spectrum_peaks
from tests.radar.targets import (
    CASCADE,
    FLAT,
    SMALL,
    noise,
    plane_wave,
    sines,
    single,
    waves_towards,
)

NARROW = RadarSpec.awr1843(design_frequency_hz=90e9)  # elements closer than half a wave
FULL = RadarSpec.awr1843(tx_positions=[(a, e) for e in range(4) for a in (0, 4)])
ALL = {"chip": SMALL, "narrow": NARROW, "flat": FLAT, "full": FULL, "cascade": CASCADE}
BINS = {"cascade": {"num_azimuth": 128, "num_elevation": 64}}
COUNT = 300  # cells, in several blocks


def radars(*names):
    """Parameters `radar` and its `bins`."""
    cases = [(ALL[name], BINS.get(name, {})) for name in names]
    return pytest.mark.parametrize(("radar", "bins"), cases, ids=names)


def random_waves(radar):
    """Azimuth, elevation and the snapshots of far targets there."""
    rng = np.random.default_rng(0)
    azimuth = rng.uniform(-1.2, 1.2, COUNT)
    elevation = rng.uniform(-0.5, 0.5, COUNT) * radar.has_elevation
    return azimuth, elevation, plane_wave(radar, azimuth, elevation)


def noisy_waves(radar):
    *_, waves = random_waves(radar)
    return single(waves + 0.3 * noise(*waves.shape, seed=1))


@radars(*ALL)
def test_plane_wave_comes_back(radar, bins):
    *angles, waves = random_waves(radar)
    found = directions(single(waves), radar, **bins)
    for sine, truth in zip(sines(*found), sines(*angles), strict=True):
        np.testing.assert_allclose(sine, truth, atol=2e-3)


@radars(*ALL)
def test_agrees_with_the_whole_spectrum(radar, bins):
    cells = noisy_waves(radar)
    fast = directions(cells, radar, **bins)
    peaks = spectrum_peaks(angle_spectrum(cells, radar, **bins), radar, count=1)
    oracle = peaks.azimuth[:, 0], peaks.elevation[:, 0]
    u, w = direction_sines(radar, **bins)
    du, dw = (a - b for a, b in zip(sines(*fast), sines(*oracle), strict=True))
    assert np.mean(np.abs(du) <= u[1] - u[0]) > 0.97  # else two peaks are as high
    if radar.has_elevation:
        assert np.mean(np.abs(dw) <= w[1] - w[0]) > 0.95


@radars("narrow", "cascade")
def test_first_peak_is_the_strongest_bin_that_is_a_direction(radar, bins):
    spectrum = angle_spectrum(noisy_waves(radar), radar, **bins)
    peaks = spectrum_peaks(spectrum, radar, count=3)
    u, w = direction_sines(radar, **bins)
    highest = jnp.where(u**2 + w[:, None] ** 2 <= 1, spectrum, 0).max((1, 2))
    np.testing.assert_array_equal(peaks.power[:, 0], highest)
    assert np.asarray(peaks.valid)[:, 0].all()


@radars("chip", "narrow")
def test_two_rows_reach_the_joint_maximum(radar, bins):
    """No visible elevation of any azimuth bin holds more power than what is found."""
    cells = noise(200, 12, seed=1)
    found = np.float64(directions(single(cells), radar, interpolate=False))
    power = np.abs((cells * plane_wave(radar, *found).conj()).sum(1))
    grid = np.meshgrid(direction_sines(radar)[0], np.linspace(-1, 1, 401))
    visible = np.hypot(*grid) <= 1
    beams = waves_towards(radar, *(side[visible] for side in grid))
    best = np.abs(cells @ beams.conj().T).max(1)
    assert (power >= best * (1 - 5e-5)).all()


@radars("chip", "cascade")
def test_directions_do_not_depend_on_scale_batch_or_block(radar, bins, monkeypatch):
    cells = noisy_waves(radar)
    once = directions(cells, radar, **bins)
    loud = directions(1e10 * cells.reshape(3, 100, -1), radar, **bins)
    monkeypatch.setattr(direction, "BLOCK", 7)  # the number of cells is new here
    few = directions(cells[:23], radar, **bins)
    mapped = jax.vmap(lambda cell: directions(cell, radar, **bins))(cells[:23])
    for a, b, c, d in zip(once, loud, few, mapped, strict=True):
        np.testing.assert_allclose(a.reshape(3, 100), b, atol=2e-3)
        np.testing.assert_allclose(a[:23], c, atol=2e-3)
        np.testing.assert_allclose(a[:23], d, atol=2e-3)


@pytest.mark.slow
@radars("chip", "cascade")
def test_gradients_are_slopes_and_finite_in_empty_cells_and_at_the_edge(radar, bins):
    angles = np.array([[0.3, 0.3, np.pi / 2, -np.pi / 2], [0.2, 0.0, 0, 0]])
    waves = plane_wave(radar, *angles)
    random = noise(130, radar.num_virtual, seed=1)
    cells = single(np.concatenate([waves, 0 * waves[:1], random]))
    cells = cells.at[0].add(single(0.1 * random[0]))

    @jax.jit
    def both(real, imag):
        return directions(jax.lax.complex(real, imag), radar, **bins)

    parts = cells.real, cells.imag
    slopes = jax.jit(jax.grad(lambda *p: sum(map(jnp.sum, both(*p))), (0, 1)))(*parts)
    for part in slopes:
        assert np.isfinite(part).all() and np.abs(part).max() > 0
    step = 3e-3 * radar.num_virtual**0.5
    change = jnp.zeros(cells.shape).at[0, 3].set(step)
    ends = (sum(both(cells.real + k * change, cells.imag))[0] for k in (1, -1))
    difference = np.subtract(*ends) / (2 * step)
    np.testing.assert_allclose(slopes[0][0, 3], difference, rtol=0.02)


def test_two_targets_of_a_cell_are_both_found():
    cell = plane_wave(FULL, -0.3, 0.4) + 0.8j * plane_wave(FULL, -0.2, -0.4)
    peaks = spectrum_peaks(angle_spectrum(single(cell), FULL), FULL, count=4)
    np.testing.assert_array_equal(peaks.valid, [True, True, False, False])
    np.testing.assert_allclose(peaks.azimuth[:2], [-0.3, -0.2], atol=0.03)
    np.testing.assert_allclose(peaks.elevation[:2], [0.4, -0.4], atol=0.03)
    assert (np.diff(peaks.power) <= 0).all()


def test_a_cell_without_power_or_peaks_has_no_valid_ones():
    peaks = spectrum_peaks(jnp.zeros((32, 64)), SMALL, count=2)
    assert not peaks.valid.any() and np.isfinite(peaks.azimuth).all()
    smooth = angle_spectrum(single(plane_wave(SMALL, 0.1, 0.0)), SMALL)
    assert spectrum_peaks(smooth, SMALL, count=2).valid.sum() == 1


def test_what_does_not_fit_is_refused():
    for function in (directions, angle_spectrum):
        with pytest.raises(ValueError, match="7 rows and 86 columns: ask for more bin"):
            function(jnp.zeros(192, complex), CASCADE)
        with pytest.raises(ValueError, match="8 values per snapshot, awr1843 has 3 tx"):
            function(jnp.zeros(8, complex), SMALL)
    with pytest.raises(ValueError, match="count=0, expected 1 to .* 32 x 64 bins"):
        spectrum_peaks(jnp.zeros((32, 64)), SMALL, count=0)
