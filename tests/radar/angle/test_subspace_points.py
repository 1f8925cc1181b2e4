"""Points by Capon and MUSIC: both angles, and two targets of a cell within a beam."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import PointSpec
from jradar.radar.angle.subspace_peaks import subspace_peaks
from tests.radar.targets import (
    CASCADE,
    FLAT,
    LIGHT,
    SMALL,
    cloud_of,
    degrees,
    simulate,
    sines,
    single,
    target,
    targets,
    waves_towards,
)

METHODS = pytest.mark.parametrize("method", ["capon", "music"])
ONE = PointSpec(detector="ca", capacity=1)
TWO = dataclasses.replace(ONE, peaks=2, group_peaks=True, capacity=2)
PLACES = [(-55, 4), (-30, -14), (0, 0), (12, -5), (52, -8)]


@METHODS
@pytest.mark.parametrize("place", PLACES, ids=str)
def test_points_have_the_azimuth_and_elevation_of_the_target(method, place):
    cube = simulate(target(4.0, *place, 0.0))
    points = dataclasses.replace(ONE, angles=method)
    found = degrees(cloud_of(cube, points=points))
    np.testing.assert_allclose(found, [place], atol=0.4)


def two_in_a_cell(places, phase):
    """A cube of two equal targets in one cell, `phase` radians apart in the middle."""
    middle_s = SMALL.adc_start_time_s + 63 / 2 / SMALL.sample_rate_hz
    middle_hz = SMALL.start_frequency_hz + SMALL.slope_hz_per_s * middle_s
    farther = phase / (4 * np.pi) * LIGHT / middle_hz
    truth = targets((4.0, *places[0], 0.0), (4.0 + farther, *places[1], 0.0))
    return simulate(truth, noise_power=0.01)


def found_places(cube, points):
    """Azimuth and elevation in degrees of two points, the rightmost first."""
    cloud = cloud_of(cube, points=points)
    found = np.where(cloud.valid[:, None], degrees(cloud, 2), 90.0)
    return found[found[:, 0].argsort()]


@METHODS
def test_two_targets_of_a_cell_within_a_beam_are_two_points(method):
    # 8 elements of half a wavelength resolve 0.245 in the sine, 14 degrees.
    places = [(-4.0, -1.0), (4.0, 5.0)]
    cube = two_in_a_cell(places, 1.6)
    assert np.abs(found_places(cube, TWO) - places).max() > 4  # by the FFT
    found = found_places(cube, dataclasses.replace(TWO, angles=method))
    np.testing.assert_allclose(found, places, atol=0.3)


@pytest.mark.parametrize(
    "changes", [{"angles": "capon"}, {"angles": "music", "sources": 0}], ids=str
)
def test_one_target_of_a_cell_stays_one_point(changes):
    cube = simulate(target(4.0, 10, 5, 0.0), seed=1)
    points = dataclasses.replace(TWO, **changes)
    cloud = cloud_of(cube, points=points)
    assert cloud.valid.tolist() == [True, False]
    np.testing.assert_allclose(degrees(cloud), [[10, 5]], atol=1)


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


def test_what_has_no_peaks_is_refused_or_not_valid():
    wave = np.exp(0.3j * SMALL.virtual_positions.sum(1))
    cells = single(np.stack([0 * wave, wave]))
    peaks = subspace_peaks(cells, SMALL, method="music", num_sources=1)
    assert peaks.valid.tolist() == [[False, False], [True, False]]
    assert np.isfinite(peaks.azimuth).all()
    assert peaks.azimuth[1, 0] > 0.05 and peaks.elevation[1, 0] > 0.05
    for shape, options, message in (
        ((3, 12), {"method": "esprit"}, "method='esprit', expected one of"),
        ((3, 12), {"method": "capon", "count": 0}, "count=0, expected 1 to 256 targ"),
        ((3, 8), {"method": "capon"}, "8 values per snapshot, awr1843 has"),
    ):
        with pytest.raises(ValueError, match=message):
            subspace_peaks(jnp.zeros(shape, complex), SMALL, **options)
