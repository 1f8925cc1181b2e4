"""Clusters that the radar saw: against all pairs, at eps, voxels, no points."""

import sys

import numpy as np
import pytest
from scipy.spatial import cKDTree

from jradar.lidar.visible import visible_mask, voxel_filter

pytest.importorskip("sklearn")

ALL = {"voxel_m": 0.0}
EMPTY = np.zeros((0, 3), np.float32)


def visible_by_all_pairs(lidar, radar, eps, min_points):
    """The definition: who is a neighbour, who is core, who is reached from whom."""
    xyz = np.concatenate([lidar, radar]).astype(float)
    near = np.linalg.norm(xyz[:, None] - xyz, axis=-1) <= eps
    core = near.sum(-1) >= min_points
    cluster = np.full(len(xyz), -1)
    for start in np.flatnonzero(core):
        if cluster[start] < 0:
            reached = np.zeros(len(xyz), bool)
            edge = np.zeros(len(xyz), bool)
            edge[start] = True
            while edge.any():
                reached |= edge
                edge = near[edge & core].any(0) & ~reached
            cluster[reached & (cluster < 0)] = start
    seen = set(cluster[len(lidar) :]) - {-1}
    by_echo = near[: len(lidar), len(lidar) :].any(-1)
    return np.array(
        [c in seen or (c < 0 and e) for c, e in zip(cluster, by_echo, strict=False)]
    )


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


def test_radar_points_can_bridge_a_gap():
    rng = np.random.default_rng(0)
    one, other = rng.normal(0, 0.05, (2, 50, 3)) + [[[0, 0, 0]], [[1.2, 0, 0]]]
    lidar = np.concatenate([one, other])
    echoes = np.stack([np.linspace(0, 1.2, 9), np.zeros(9), np.zeros(9)], -1)
    assert visible_mask(lidar, echoes, eps_m=0.3, **ALL).all()
    assert visible_mask(lidar, echoes[:2], eps_m=0.3, **ALL).tolist() == (
        [True] * 50 + [False] * 50
    )


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


def test_voxel_filter_keeps_one_point_of_each_voxel():
    xyz = np.random.default_rng(0).uniform(-4, 4, (20_000, 3)).astype(np.float32)
    first, voxel = voxel_filter(xyz, voxel_m=0.5, max_points=10_000)
    cells = np.floor(xyz.astype(float) / 0.5)
    np.testing.assert_array_equal(cells, cells[first][voxel])
    assert len(np.unique(cells, axis=0)) == len(first)
    assert (voxel[first] == np.arange(len(first))).all()


@pytest.mark.parametrize("most", [1, 100, 8000])
def test_voxels_grow_until_few_are_left(most):
    xyz = np.random.default_rng(0).uniform(0, 4, (20_000, 3))
    first, voxel = voxel_filter(xyz, voxel_m=0.01, max_points=most)
    assert most / 5 <= len(first) <= most and voxel.max() == len(first) - 1
    reach, _ = cKDTree(xyz[first]).query(xyz)
    assert reach.max() < 12 / most ** (1 / 3)  # they still cover the cloud


@pytest.mark.parametrize(
    ("lidar", "radar"),
    [
        (EMPTY, EMPTY),
        (EMPTY, np.ones((3, 3))),
        (np.ones((3, 3)), EMPTY),
        (np.full((3, 3), np.nan), np.ones((3, 3))),
        (np.zeros((3, 3)), np.full((3, 3), 0.1)),
        (np.ones((3, 3)), np.full((3, 3), np.nan)),
    ],
)
def test_nothing_is_seen_without_both_clouds(lidar, radar):
    seen = visible_mask(lidar, radar)
    assert seen.shape == (len(lidar),) and not seen.any()


def test_one_point_and_bad_neighbours():
    lidar = np.array([[2.0, 0, 0], [np.nan, 0, 0], [0, 0, 0]])
    radar = np.array([[2.1, 0, 0], [np.inf, 0, 0], [0, 0, 0]])
    assert visible_mask(lidar, radar).tolist() == [True, False, False]


def test_missing_package_names_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "sklearn.cluster", None)
    with pytest.raises(ImportError, match=r"jradar\[data\]"):
        visible_mask(np.ones((3, 3)), np.ones((1, 3)))
