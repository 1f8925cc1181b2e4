"""One point for each target, one cluster for each object."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import PointSpec, cluster, detect, power_map
from jradar.radar.detect.clusters import map_peaks
from jradar.types import PointCloud
from tests.radar.targets import SMALL, cloud_of, simulate, spherical, targets

STRICT = PointSpec(false_alarm_rate=1e-6, capacity=64)
GROUPED = dataclasses.replace(STRICT, group_peaks=True)
PLACES = [(3.3, 10, 0, 0.5), (5.1, -20, 3, -1.0), (7.2, 30, -4, 0.0)]


@pytest.mark.parametrize("amplitude", [5.0, 100.0])
def test_three_targets_give_three_points(amplitude):
    cube = simulate(targets(*PLACES, amplitude=amplitude))
    assert cloud_of(cube, points=STRICT).valid.sum() > 20
    cloud = cloud_of(cube, points=GROUPED)
    assert cloud.valid.sum() == 3
    found = sorted(spherical(cloud.xyz[:3])[0])
    expected = [place[0] for place in PLACES]
    np.testing.assert_allclose(found, expected, atol=SMALL.range_resolution_m)


def test_grouped_cells_are_the_detected_ones_that_are_peaks():
    power = power_map(simulate(targets(*PLACES, amplitude=30.0)))
    loose = dataclasses.replace(STRICT, false_alarm_rate=0.3)
    grouped = detect(power, SMALL, points=dataclasses.replace(loose, group_peaks=True))
    marked = detect(power, SMALL, points=loose)
    np.testing.assert_array_equal(grouped, marked & map_peaks(power))
    assert 3 <= grouped.sum() < marked.sum() / 2


def test_peaks_are_those_of_a_loop_with_wrapped_doppler():
    power = np.random.default_rng(0).integers(0, 9, (2, 6, 7)).astype(np.float32)
    for one, found in zip(power, map_peaks(jnp.asarray(power)), strict=True):
        for row, column in np.ndindex(one.shape):
            rows = [(row + k) % 6 for k in (-1, 0, 1)]
            columns = [c for c in (column - 1, column, column + 1) if 0 <= c < 7]
            near = one[np.ix_(rows, columns)]
            highest = one[row, column] == near.max()
            alone = (near == near.max()).sum() == 1
            assert highest or not found[row, column]
            assert found[row, column] or not (highest and alone)


def test_points_of_one_object_are_one_cluster():
    rng = np.random.default_rng(0)
    near, far = np.array([3.0, 1.0, 0.0]), np.array([6.0, -2.0, 0.5])
    others = far + np.zeros((2, 3))
    xyz = np.concatenate([near + 0.2 * rng.uniform(-1, 1, (6, 3)), others, [near]])
    cloud = PointCloud(
        xyz=jnp.asarray(xyz, jnp.float32),
        valid=jnp.array([True] * 9),
        velocity=jnp.array([1.0] * 6 + [-2.0, -2.2] + [-3.0]),
        power=jnp.array([1.0] * 6 + [30.0, 10.0] + [0.5]),
    )
    strong, weak, crossing = cluster(cloud)
    assert sorted(strong.points) == [6, 7] and sorted(weak.points) == [*range(6)]
    assert crossing.points.tolist() == [8]  # at the same place, with another velocity
    np.testing.assert_allclose(strong.centre, far, atol=1e-6)
    assert strong.velocity == pytest.approx((-2.0 * 30 - 2.2 * 10) / 40)
    np.testing.assert_allclose(weak.centre, xyz[:6].mean(0), atol=1e-6)
    np.testing.assert_allclose(weak.extent, np.ptp(xyz[:6], axis=0), atol=1e-6)
    assert (weak.power, weak.velocity) == (6.0, pytest.approx(1.0))
    assert len(cluster(cloud, min_points=2)) == 2
    assert len(cluster(cloud._replace(velocity=None), min_points=2)) == 2
    assert cluster(cloud._replace(valid=jnp.zeros(9, bool))) == []


def test_what_cannot_be_clustered_is_named():
    cloud = PointCloud.from_xyz(np.ones((2, 3, 3)))
    with pytest.raises(ValueError, match="pass one cloud at a time"):
        cluster(cloud)
    with pytest.raises(ValueError, match="radius_m=0.0, .*expected radii above 0"):
        cluster(PointCloud.from_xyz(np.ones((3, 3))), radius_m=0.0)
