"""Voxel maps against rays by hand."""

import math

import numpy as np
import pytest

from jradar.mapping import SensorModel, VoxelMap


def test_log_odds_are_those_of_hits_and_of_rays_through_a_voxel():
    sensor = SensorModel(voxel_m=1.0, hit=0.7, miss=0.4)
    found = VoxelMap(sensor)
    pose = np.eye(4)
    pose[:3, 3] = 0.5, 0.5, 0.5
    for _ in range(2):
        found.add([[4.0, 0.0, 0.0]], pose)  # ends in voxel 4, passes 0 to 3
    found.add([[7.0, 0.0, 0.0]], pose)  # passes voxel 4 and ends in 7
    voxels, probability = found.occupied(above=0.0)
    by_voxel = dict(zip(map(tuple, voxels.tolist()), probability, strict=True))
    odds = {p: math.log(p / (1 - p)) for p in (0.7, 0.4)}
    expected = 1 / (1 + math.exp(-2 * odds[0.7] - odds[0.4]))
    assert by_voxel[4, 0, 0] == pytest.approx(expected)
    assert by_voxel[7, 0, 0] == pytest.approx(0.7)
    assert by_voxel[2, 0, 0] == pytest.approx(1 / (1 + math.exp(-3 * odds[0.4])))
    free = {tuple(v) for v in found.free().tolist()}
    assert free == {(x, 0, 0) for x in (0, 1, 2, 3, 5, 6)}


def test_a_voxel_counts_once_a_frame_within_bounds_and_range():
    found = VoxelMap(SensorModel(voxel_m=1.0, max_range_m=5.0))
    found.add([[2.2, 0.1, 0.1]] * 9 + [[6.0, 0.0, 0.0], [np.nan, 0, 0]], np.eye(4))
    voxels, probability = found.occupied()
    assert voxels.tolist() == [[2, 0, 0]]
    assert probability == pytest.approx(0.7)
    for _ in range(200):
        found.add([[2.2, 0.1, 0.1]], np.eye(4))
    assert found.occupied()[1] == pytest.approx(0.97)


def test_a_voxel_with_a_point_is_not_missed_by_a_ray_of_its_frame():
    found = VoxelMap(SensorModel(voxel_m=1.0))
    found.add(
        [[2.5, 0.5, 0.5], [6.5, 1.3, 1.3]], np.eye(4)
    )  # the second passes (2, 0, 0)
    voxels, probability = found.occupied(above=0.0)
    by_voxel = dict(zip(map(tuple, voxels.tolist()), probability, strict=True))
    assert by_voxel[2, 0, 0] == pytest.approx(0.7)
    assert by_voxel[3, 0, 0] == pytest.approx(0.4)


@pytest.mark.parametrize("read", [False, True])
def test_bounds_act_after_every_frame_whenever_the_map_is_read(read):
    found = VoxelMap(SensorModel(voxel_m=1.0))
    hit, behind = [[2.5, 0.5, 0.5]], [[4.5, 0.5, 0.5]]
    for xyz in 40 * [hit] + 10 * [behind]:
        found.add(xyz, np.eye(4))
        if read:
            found.occupied()
    voxels, probability = found.occupied(above=0.0)
    by_voxel = dict(zip(map(tuple, voxels.tolist()), probability, strict=True))
    odds = math.log(0.97 / 0.03) + 10 * math.log(0.4 / 0.6)
    assert by_voxel[2, 0, 0] == pytest.approx(1 / (1 + math.exp(-odds)))
    assert by_voxel[0, 0, 0] == pytest.approx(0.12)


def test_a_voxel_takes_the_largest_probability_of_its_points():
    found = VoxelMap(SensorModel(voxel_m=1.0))
    xyz = np.array([[2.2, 0.1, 0.1], [2.4, 0.2, 0.2], [2.3, 5.5, 0.1]])
    found.add(xyz, np.eye(4), probability=np.array([0.6, 0.9, 0.3]))
    voxels, probability = found.occupied(above=0.0)
    by_voxel = dict(zip(map(tuple, voxels.tolist()), probability, strict=True))
    assert by_voxel[2, 0, 0] == pytest.approx(0.9)
    assert by_voxel[2, 5, 0] == pytest.approx(0.3)


def test_a_map_does_not_depend_on_where_its_world_begins():
    rng = np.random.default_rng(0)
    points, far = rng.uniform(-4, 4, (50, 3)), np.eye(4)
    far[:3, 3] = -150.0, 300.0, 45.0  # whole voxels
    maps = [VoxelMap(), VoxelMap()]
    for voxel_map, pose in zip(maps, (np.eye(4), far), strict=True):
        voxel_map.add(points, pose)
    shift = np.array([-1000, 2000, 300])
    assert (maps[0].occupied()[0] + shift).tolist() == maps[1].occupied()[0].tolist()


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [-1, 1])
def test_far_voxels_come_back_where_they_are_or_are_refused(axis, side):
    pose = np.eye(4)
    pose[axis, 3] = side * 78_632.0
    found, step = VoxelMap(), np.zeros((1, 3))
    step[0, axis] = side * 9.9
    found.add(step, pose)
    (voxel,) = found.occupied()[0]
    assert (voxel[axis] + 0.5) * 0.15 == pytest.approx(side * 78_641.9, abs=0.15)
    pose[axis, 3] = side * 79_000.0
    with pytest.raises(ValueError, match="less than 78,633 m along each axis"):
        found.add(step, pose)


@pytest.mark.parametrize("pose", [np.full((4, 4), np.nan), np.diag([1, 1, 1, 1.0]) * 1])
def test_a_pose_that_is_no_place_is_refused(pose):
    pose = np.array(pose)
    pose[0, 3] = pose[0, 3] if np.isnan(pose[0, 3]) else 1e6
    with pytest.raises(ValueError, match="expected finite numbers of metres"):
        VoxelMap().add([[1.0, 0, 0]], pose)


@pytest.mark.parametrize(
    "values", [{"hit": 0.4}, {"miss": 0.6}, {"least": 0.45}, {"voxel_m": 0.0}]
)
def test_a_sensor_model_that_says_the_opposite_is_refused(values):
    with pytest.raises(ValueError, match="expected"):
        SensorModel(**values)


def test_what_frames_bring_does_not_pile_up():
    found = VoxelMap(SensorModel(voxel_m=1.0))
    for _ in range(300):
        found.add([[2.5, 0.5, 0.5]], np.eye(4))
    assert len(found._new) < 200
