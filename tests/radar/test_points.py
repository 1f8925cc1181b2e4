"""Simulated targets come back; flat arrays; capacity; peaks; reports; options."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import (
    PointSpec,
    Radar,
    points_and_count,
    power_map,
    radar_points,
    strongest_echoes,
)
from jradar.radar.angle.spectrum import azimuth_bins, direction_sines
from tests.radar.targets import (
    CASCADE,
    CELLS,
    COLUMN,
    FLAT,
    ONE,
    SMALL,
    STATIC,
    WIDE,
    close,
    cloud_of,
    simulate,
    sines,
    spherical,
    target,
    targets,
)

PEAKS = dataclasses.replace(CELLS, peaks=2, capacity=64, false_alarm_rate=1e-12)
FEW = dataclasses.replace(CELLS, capacity=8)
UNIT = Radar(SMALL)


@pytest.fixture(scope="module")
def cube():
    return simulate(target(5, 20, 5, 1))


@pytest.fixture(scope="module")
def cloud(cube):
    return cloud_of(cube)


@pytest.mark.parametrize(
    "truth", [(5.3, 21.0, 8.0, 0.77), (6.5, -33.0, -12.0, -1.24), (2.1, 4.0, 3.0, 1.6)]
)
def test_a_target_of_a_cascade_comes_back_within_half_a_bin(truth):
    """Those of a chip are compared with their deviations elsewhere."""
    cloud = cloud_of(simulate(target(*truth), CASCADE), CASCADE, WIDE)
    distance, *angles = (v[0] for v in spherical(cloud.xyz[:1]))
    assert abs(distance - truth[0]) < CASCADE.range_resolution_m / 2
    assert abs(cloud.velocity[0] - truth[3]) < CASCADE.velocity_resolution_mps / 2
    away = np.abs(np.subtract(sines(*angles), sines(*np.radians(truth[1:3]))))
    bins = direction_sines(CASCADE, num_azimuth=azimuth_bins(CASCADE))
    assert (away < [(grid[1] - grid[0]) / 2 for grid in bins]).all()


def test_without_refinement_points_lie_on_bins(cube):
    cloud = cloud_of(cube, points=STATIC)
    ranges = spherical(cloud.xyz[cloud.valid])[0] / SMALL.range_resolution_m
    speeds = cloud.velocity[cloud.valid] / SMALL.velocity_resolution_mps
    assert len(ranges) > 1
    for bins in (ranges, speeds):
        np.testing.assert_allclose(bins, np.round(bins), atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("radar", "peaks", "place", "blind"),
    [
        (FLAT, 1, (5, 20, 0, 1), [2]),
        (COLUMN, 1, (5, 0, 15, 1), [1]),
        (COLUMN, 2, (5, 0, 15, 1), [1]),
        (ONE, 1, (5, 0, 0, 1), [1, 2]),
    ],
    ids=["one row", "one column", "one column, two peaks", "one antenna"],
)
def test_axes_that_an_array_does_not_measure_are_zero(radar, peaks, place, blind):
    points = dataclasses.replace(CELLS, peaks=peaks)
    cloud = cloud_of(simulate(target(*place), radar), radar, points)
    assert cloud.valid.any() and not cloud.xyz[:, blind].any()
    found = spherical(cloud.xyz[:1])
    assert abs(found[0][0] - 5) < radar.range_resolution_m
    np.testing.assert_allclose(np.degrees(found[1:])[:, 0], place[1:3], atol=2)


def test_the_strongest_come_first_and_those_beyond_capacity_are_counted(cube, cloud):
    few, detected = points_and_count(cube, UNIT, points=FEW)
    assert few.valid.all() and detected == cloud.valid.sum() > 8
    assert (np.diff(cloud.power) <= 0).all() and not cloud.xyz[~cloud.valid].any()
    close(few, jax.tree.map(lambda column: column[:8], cloud), 1e-5)


def test_a_sample_that_is_no_number_leaves_no_points(cube):
    broken = cube.at[2, 3, 4, 5].set(jnp.nan).at[0, 0, 9, 9].set(jnp.inf)
    cloud, detected = points_and_count(broken, UNIT, points=FEW)
    assert detected == 0 and not cloud.valid.any()


def test_two_targets_in_a_cell_are_two_points():
    distance, degrees = 16 * SMALL.range_resolution_m, (25, -30)
    both = targets(*((distance, angle, 0, 0) for angle in degrees))
    cube = simulate(both._replace(amplitude=jnp.array([100.0, 90.0])))
    one, two = (cloud_of(cube, points=p) for p in (CELLS, PEAKS))
    found = spherical(two.xyz[:2])
    half_a_beam = 1 / (SMALL.virtual_positions[:, 0].max() + 1)  # in direction sines
    expected = np.sin(np.radians(sorted(degrees)))
    np.testing.assert_allclose(np.sort(np.sin(found[1])), expected, atol=half_a_beam)
    np.testing.assert_allclose(found[0], distance, rtol=0.01)
    assert two.power[0] == pytest.approx(one.power[0])
    assert two.power[1] > two.power[0] / 4
    np.testing.assert_allclose(two.xyz[0], one.xyz[0], atol=0.1)
    assert two.snr[1] / two.snr[0] == pytest.approx(two.power[1] / two.power[0])
    assert (np.diff(two.power) <= 0).all()


def test_one_target_in_a_cell_is_one_point_with_two_peaks():
    cube = simulate(target(5, 20, 5, 1, amplitude=300.0))
    one, two = (cloud_of(cube, points=p) for p in (CELLS, PEAKS))
    count = two.valid.sum()
    assert 0 < count < 64
    np.testing.assert_allclose(two.power[:count], one.power[:count], rtol=1e-6)
    azimuths = [spherical(cloud.xyz[:1])[1] for cloud in (one, two)]
    np.testing.assert_allclose(*azimuths, atol=0.01)


def test_windows_are_options(cube, cloud):
    windows = {"range_window": "blackman", "doppler_window": "none"}
    points = dataclasses.replace(CELLS, **windows)
    found = cloud_of(cube, points=points).power[0]
    assert found == pytest.approx(float(power_map(cube, **windows).max()), rel=1e-5)
    assert found != pytest.approx(cloud.power[0], rel=1e-3)
    blackman = dataclasses.replace(FEW, doppler_window="blackman")
    fast = 5.3 * SMALL.velocity_resolution_mps  # between bins
    strong = simulate(target(5, 20, 5, fast, amplitude=1e4))
    placed = cloud_of(strong, points=blackman).velocity[0]
    assert placed == pytest.approx(fast, rel=1e-4)


def test_strongest_echo_is_the_target_and_others_are_apart(cloud):
    first, *others = strongest_echoes(cloud, SMALL)
    assert first.range_m == pytest.approx(5, abs=SMALL.range_resolution_m)
    assert first.azimuth_deg == pytest.approx(20, abs=2)
    assert others
    for echo in others:
        bins = echo.range_bin - first.range_bin, echo.doppler_bin - first.doppler_bin
        assert echo.power_db < first.power_db and max(map(abs, bins)) > 3


def test_options_are_fitted_to_a_radar():
    window = {"guard": (2, 2), "train": (6, 6)}
    fitted = PointSpec(**window, capacity=7).fitted(CASCADE)  # 16 chirps
    assert (fitted.guard, fitted.train) == ((1, 2), (6, 6))
    assert (fitted.num_azimuth, fitted.capacity) == (None, 7)
    assert (azimuth_bins(SMALL), azimuth_bins(CASCADE)) == (64, 256)
    assert PointSpec(num_azimuth=128).fitted(CASCADE).num_azimuth == 128
    most = PointSpec(capacity=1 << 20, peaks=2).fitted(CASCADE)
    assert most.capacity == 2 * CASCADE.num_chirps * CASCADE.num_samples
    assert PointSpec().fitted(SMALL) == PointSpec()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"detector": "xx"}, "detector = 'xx', expected one of"),
        ({"angles": "esprit"}, "angles = 'esprit', expected one of"),
        ({"false_alarm_rate": 1.5}, "false_alarm_rate = 1.5, expected 0 < rate <= 1"),
        ({"capacity": 0}, "capacity = 0, expected 1 to 1,048,576"),
        ({"capacity": 99999999999}, "capacity = 99,999,999,999, expected 1 to 1,0"),
        ({"guard": (-1, 2)}, r"guard = \(-1, 2\), expected two whole numbers"),
        ({"range_window": "kaiser"}, "range_window = 'kaiser', expected one of"),
        ({"num_azimuth": 0}, "num_azimuth = 0, expected 1 to 4,096"),
        ({"edge": "mirror"}, "edge = 'mirror', expected one of"),
        ({"edge": "fill"}, "edge='fill' with kind='os'"),
        ({"factor": -1.0}, "factor = -1.0, expected more than 0"),
        ({"guard": 2}, "guard = 2, expected two whole numbers"),
        ({"train": (4, 4, 4)}, r"train = \(4, 4, 4\), expected two whole numbers"),
        ({"folds": -1}, "folds = -1, expected 0 to 16"),
        ({"sources": 0}, "sources = 0, expected 1 to 64"),
        ({"focus": True, "angles": "music"}, "expected 'fft' and 1: a focus has one"),
        ({"focus": True, "peaks": 2}, "expected 'fft' and 1: a focus has one"),
    ],
)
@pytest.mark.usefixtures("as_a_user")
def test_impossible_options_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        PointSpec(**options)
    tuples = PointSpec(guard=(1, 2), train=(3, 4))
    assert PointSpec(guard=[1, 2], train=[3, 4]) == tuples  # a list is fine


def test_what_an_array_cannot_give_is_refused():
    with pytest.raises(ValueError, match=r"shape \(2, 4, 8, 16\), awr1843 needs"):
        radar_points(jnp.zeros((2, 4, 8, 16), complex), UNIT)
    music = dataclasses.replace(CELLS, angles="music")
    with pytest.raises(ValueError, match="need neighbouring elements in a row"):
        cloud_of(jnp.zeros(ONE.cube_shape, complex), ONE, music)
