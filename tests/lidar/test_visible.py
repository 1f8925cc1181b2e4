"""Clusters that the radar saw: against all pairs, at eps, voxels, no points."""

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree, distance_matrix

from jradar.lidar.visible import visible_mask, voxel_filter

pytest.importorskip("sklearn")

ALL = {"voxel_m": 0.0}
EMPTY = np.zeros((0, 3), np.float32)


def visible_by_all_pairs(lidar, radar, eps, min_points):
    """The definition: who is a neighbour, who is core, who is reached from whom."""
    xyz = np.concatenate([lidar, radar])
    near = distance_matrix(xyz, xyz) <= eps
    core = near.sum(-1) >= min_points
    _, group = connected_components(near & core & core[:, None])
    reached = np.where(near & core, group, len(xyz)).min(-1)  # from the first cluster
    seen = set(reached[len(lidar) :]) - {len(xyz)}
    by_echo = (reached == len(xyz)) & near[:, len(lidar) :].any(-1)
    return (np.isin(reached, [*seen]) | by_echo)[: len(lidar)]


@pytest.mark.parametrize(("eps", "min_points"), [(0.3, 3), (0.5, 8), (1.0, 20)])
def test_all_points_follow_the_definition(eps, min_points):
    rng = np.random.default_rng(min_points)
    centres = rng.uniform(-6, 6, (12, 3))
    lidar = centres[rng.integers(12, size=500)] + rng.normal(0, 0.3, (500, 3))
    radar = centres[rng.integers(4, size=15)] + rng.normal(0, 0.5, (15, 3))
    seen = visible_mask(lidar, radar, eps_m=eps, min_points=min_points, **ALL)
    expected = visible_by_all_pairs(lidar, radar, eps, min_points)
    np.testing.assert_array_equal(seen, expected)
    assert 0 < seen.sum() < 500


@pytest.mark.parametrize(("gap", "seen"), [(0.5, True), (0.500001, False)])
def test_eps_is_within_reach(gap, seen):
    """Echo and row of points: neighbours at exactly eps."""
    row = np.stack([2 + np.arange(8) * 0.5, np.zeros(8), np.zeros(8)], -1)
    echo = np.array([[2 - gap, 0.0, 0.0]])
    found = visible_mask(row, echo, eps_m=0.5, min_points=2, **ALL)
    assert found.tolist() == [seen] * 8


def test_a_lone_point_stays_if_the_radar_saw_it():
    lone = np.array([[3.0, 0, 0], [7.0, 0, 0]])
    echo = np.array([[3.3, 0.4, 0]])  # half a metre from the first
    assert visible_mask(lone, echo, eps_m=0.51).tolist() == [True, False]
    assert visible_mask(lone, echo, eps_m=0.49).tolist() == [False, False]


def test_voxels_decide_as_all_points_do():
    """Where clusters are farther apart than eps and voxels together."""
    rng = np.random.default_rng(3)
    centres = np.array([[x, y, 0] for x in (0, 3, 6) for y in (-3, 0, 3)], float)
    lidar = np.concatenate([rng.uniform(-0.5, 0.5, (3000, 3)) + c for c in centres])
    radar = centres[[0, 4, 5]] + 0.1
    every = visible_mask(lidar, radar, **ALL)
    assert every.sum() == 9000
    for voxel in (0.05, 0.15, 0.3):
        seen = visible_mask(lidar, radar, voxel_m=voxel)
        np.testing.assert_array_equal(seen, every)


def test_one_point_of_each_voxel_is_kept_and_voxels_grow_until_few_are_left():
    xyz = np.random.default_rng(0).uniform(0, 4, (20_000, 3))
    first, voxel = voxel_filter(xyz, voxel_m=0.5, max_points=10_000)
    cells = np.floor(xyz / 0.5)
    np.testing.assert_array_equal(cells, cells[first][voxel])
    assert len(np.unique(cells, axis=0)) == len(first)
    assert (voxel[first] == np.arange(len(first))).all()
    for most in (1, 100, 8000):
        first, voxel = voxel_filter(xyz, voxel_m=0.01, max_points=most)
        assert most / 5 <= len(first) <= most and voxel.max() == len(first) - 1
        reach, _ = cKDTree(xyz[first]).query(xyz)
        assert reach.max() < 12 / most ** (1 / 3)  # they still cover the cloud


ONES = np.ones((3, 3))


@pytest.mark.parametrize(
    ("lidar", "radar"),
    [
        *((EMPTY, EMPTY), (EMPTY, ONES), (ONES, EMPTY), (np.nan * ONES, ONES)),
        *((0 * ONES, 0.1 * ONES), (ONES, np.nan * ONES)),
    ],
)
def test_nothing_is_seen_without_both_clouds(lidar, radar):
    seen = visible_mask(lidar, radar)
    assert seen.shape == (len(lidar),) and not seen.any()
    bad = np.array([[np.nan, 0, 0], [0, 0, 0], [np.inf, 0, 0]])
    lidar, radar = (np.concatenate([[[2.0, 0, 0]], xyz, bad]) for xyz in (lidar, radar))
    found = visible_mask(lidar, radar)
    assert found[0] and not found[-3:].any()
