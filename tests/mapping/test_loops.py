"""Loops of walks: known drift, other places, and walks that do not come back."""

import sys

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from jradar.mapping import close_loops, map_clouds, recording
from jradar.mapping.loops import path_lengths
from tests.models import tiny_map_model

CORNERS = np.array([(0, 0), (12, 0), (12, 8), (0, 8)], float)
STEP_M = 0.25
SIGHT_M = 5.0


def walls(seed):
    """Points on the outer and inner walls of a ring of corridors, and on boxes."""
    random = np.random.default_rng(seed)
    boxes = random.uniform((-1.2, -1.2), (13.2, 9.2), (40, 2))
    boxes = boxes[(abs(boxes - (6, 4)) > (4.8, 2.8)).any(1)]  # not within the block
    rings = [((-1.5, -1.5), (13.5, 9.5)), ((1.5, 1.5), (10.5, 6.5))]
    lines = []
    for (a, b), (c, d) in rings:
        for start, end in (
            ((a, b), (c, b)),
            ((c, b), (c, d)),
            ((c, d), (a, d)),
            ((a, d), (a, b)),
        ):
            share = random.uniform(size=(400, 1))
            lines.append(np.array(start) + share * np.subtract(end, start))
    for x, y in boxes:
        lines.append(np.array((x, y)) + 0.2 * random.uniform(-1, 1, (30, 2)))
    plan = np.concatenate(lines)
    return np.c_[plan, random.uniform(-1, 1.5, len(plan))]


def along(metres):
    """The pose at a place of the ring, looking ahead."""
    legs = np.array([12, 8, 12, 8])
    ends = np.cumsum(legs)
    at = metres % ends[-1]
    k = int(np.searchsorted(ends, at, side="right"))
    ahead = np.roll(CORNERS, -1, 0)[k] - CORNERS[k]
    place = CORNERS[k] + ahead * (at - ends[k] + legs[k]) / legs[k]
    pose = np.eye(4)
    yaw = np.arctan2(ahead[1], ahead[0])
    pose[:3, :3] = Rotation.from_euler("z", yaw).as_matrix()
    pose[:2, 3] = place
    return pose


def walk(metres, world, *, noise=0.02):
    """Poses of a walk along the ring, and what the radar sees of a world."""
    random = np.random.default_rng(1)
    poses = np.stack([along(s) for s in np.arange(0, metres, STEP_M)])
    clouds = []
    for pose in poses:
        near = world[np.linalg.norm(world[:, :2] - pose[:2, 3], axis=1) < SIGHT_M]
        near = near[random.choice(len(near), 60)]
        seen = (near - pose[:3, 3]) @ pose[:3, :3]
        clouds.append(np.float32(seen + noise * random.standard_normal(seen.shape)))
    return poses, clouds


def drifting(poses, *, yaw_deg_per_m, scale=1.0):
    """What odometry with a wrong rate of rotation and wrong lengths makes of poses."""
    steps = np.linalg.inv(poses[:-1]) @ poses[1:]
    steps[:, :3, 3] *= scale
    change = np.eye(4)
    angle = np.radians(yaw_deg_per_m * STEP_M)
    change[:3, :3] = Rotation.from_euler("z", angle).as_matrix()
    found = [poses[0]]
    for step in steps:
        found.append(found[-1] @ step @ change)
    return np.stack(found)


@pytest.fixture(autouse=True)
def libraries():
    for name in ("small_gicp", "gtsam"):
        pytest.importorskip(name, reason="pip install jradar[loops]")


def away_m(poses, truth):
    return np.linalg.norm(poses[:, :3, 3] - truth[:, :3, 3], axis=1)


def test_the_drift_of_two_rounds_is_corrected():
    truth, clouds = walk(90, walls(0))
    odometry = drifting(truth, yaw_deg_per_m=0.12, scale=1.01)
    found, loops = close_loops(clouds, odometry)
    assert away_m(odometry, truth)[-1] > 1.0
    assert away_m(found, truth)[-1] < 0.25
    assert away_m(found, truth).mean() < 0.4 * away_m(odometry, truth).mean()
    np.testing.assert_allclose(found[0], odometry[0], atol=1e-9)
    turned = found[-1, :3, :3].T @ truth[-1, :3, :3]
    assert np.degrees(Rotation.from_matrix(turned).magnitude()) < 3
    assert all(loop.source > loop.target for loop in loops)


def test_exact_poses_stay_where_they_are():
    truth, clouds = walk(90, walls(0))
    found, loops = close_loops(clouds, truth)
    assert loops
    assert away_m(found, truth).max() < 0.05


def test_a_walk_that_does_not_come_back_is_unchanged():
    truth, clouds = walk(30, walls(0))
    found, loops = close_loops(clouds, truth)
    assert found is truth and not loops


def test_another_place_at_the_same_poses_is_no_loop():
    truth, clouds = walk(25, walls(0))
    _, others = walk(25, walls(0)[:, [1, 0, 2]] * (1.3, 0.8, 1))
    poses = np.concatenate([truth, truth])
    found, loops = close_loops([*clouds, *others], poses)
    assert found is poses and not loops


def test_few_points_make_no_loop():
    truth, clouds = walk(90, walls(0))
    found, loops = close_loops([cloud[:1] for cloud in clouds], truth)
    assert found is truth and not loops
    found, loops = close_loops([cloud[:0] for cloud in clouds], truth)
    assert found is truth and not loops


def test_a_radar_that_stands_still_at_the_end_keeps_its_place():
    truth, clouds = walk(60, walls(0))
    standing = np.repeat(truth[-1:], 200, axis=0)
    poses = drifting(truth, yaw_deg_per_m=0.12)
    poses = np.concatenate([poses, np.repeat(poses[-1:], 200, axis=0)])
    found, _ = close_loops([*clouds, *[clouds[-1]] * 200], poses)
    truth = np.concatenate([truth, standing])
    assert away_m(found, truth)[-1] < away_m(poses, truth)[-1] / 2
    np.testing.assert_allclose(found[-200:], found[-1:].repeat(200, 0), atol=1e-9)


def test_a_map_of_a_walk_with_drift_has_its_walls_once():
    truth, clouds = walk(70, walls(0))
    poses, model = drifting(truth, yaw_deg_per_m=0.15), tiny_map_model()
    right = KDTree(map_clouds(clouds, truth, model).radar.voxels)

    said = []

    def share(*, loops):
        """The share of voxels within 0.3 m of those of the true poses, and notes."""
        options = {"loops": loops, "advance": lambda *shown: said.append(shown)}
        found = map_clouds(clouds, poses, model, **options)
        return (right.query(found.radar.voxels)[0] <= 2).mean(), found.notes

    (twice, nothing), (once, notes) = share(loops=False), share(loops=True)
    assert twice < 0.85 and once > 0.95
    assert not nothing and "loops were closed" in notes[0]
    assert said[-1] == (len(poses), "closing loops, 100 %")


def test_ctrl_c_while_loops_are_closed_keeps_the_map(monkeypatch):
    truth, clouds = walk(20, walls(0))
    monkeypatch.setattr(recording, "close_loops", interrupted)
    found = map_clouds(clouds, truth, tiny_map_model(), loops=True)
    assert found.interrupted and len(found.radar.voxels)
    assert found.notes == ("interrupted: the loops are not closed",)


def interrupted(*_, **__):
    raise KeyboardInterrupt


def test_a_straight_walk_says_that_there_is_no_loop():
    truth, clouds = walk(20, walls(0))
    found = map_clouds(clouds, truth, tiny_map_model(), loops=True)
    assert found.notes == ("no loop was found: the poses stay as they are",)
    np.testing.assert_array_equal(found.path, truth[:, :3, 3])


def test_a_missing_library_is_named_with_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "small_gicp", None)
    truth, clouds = walk(40, walls(0))
    with pytest.raises(ImportError, match=r"needs small_gicp: pip .*jradar\[loops\]"):
        close_loops(clouds, truth)


def test_lengths_are_those_along_the_path():
    truth, _ = walk(20, walls(0))
    np.testing.assert_allclose(
        path_lengths(truth[:, :3, 3]), STEP_M * np.arange(80), atol=0.2
    )
