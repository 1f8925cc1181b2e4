"""APE and RPE: closed forms, and evo's own numbers wherever the world begins."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jradar.motion.errors import position_errors, step_errors, umeyama


def walk(seed, count=30):
    random = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (count, 1, 1))
    angles = random.normal(scale=0.2, size=(count, 3)).cumsum(0)
    poses[:, :3, :3] = Rotation.from_rotvec(angles).as_matrix()
    poses[:, :3, 3] = random.normal(size=(count, 3)).cumsum(0)
    return poses


def disturbed(poses, seed=9):
    random = np.random.default_rng(seed)
    turns = random.normal(scale=0.02, size=(len(poses), 3))
    moved = poses.copy()
    moved[:, :3, :3] = moved[:, :3, :3] @ Rotation.from_rotvec(turns).as_matrix()
    moved[:, :3, 3] += random.normal(scale=0.1, size=(len(poses), 3))
    return moved


def some_motion():
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_euler("xyz", [0.3, -1.0, 2.0]).as_matrix()
    motion[:3, 3] = [5.0, -3.0, 1.0]
    return motion


def test_the_aligning_motion_is_no_mirror():
    points = np.random.default_rng(0).normal(size=(12, 3))
    mirrored = umeyama(points, points * [1, 1, -1])
    assert np.linalg.det(mirrored[:3, :3]) == pytest.approx(1)


def test_errors_of_a_scaled_straight_way():
    """A line of 10 poses 1 m apart, measured 10 % too long."""
    true = np.tile(np.eye(4), (10, 1, 1))
    true[:, 0, 3] = np.arange(10)
    estimated = true.copy()
    estimated[:, 0, 3] *= 1.1
    ape = position_errors(estimated, true)
    off = 0.1 * np.abs(np.arange(10) - 4.5)
    np.testing.assert_allclose(ape.rmse, np.sqrt(np.mean(off**2)))
    np.testing.assert_allclose(ape.max, 0.45)
    metres, degrees = step_errors(estimated, true)
    np.testing.assert_allclose(metres, [0.1] * 4)
    assert degrees.max == 0


def test_too_few_poses_are_refused(as_a_user):
    with pytest.raises(ValueError, match="3 or more"):
        position_errors(walk(1)[:2], walk(1)[:2])
    with pytest.raises(ValueError, match="as many"):
        step_errors(walk(1), walk(1)[:4])


def test_evo_finds_the_same_errors():
    metrics = pytest.importorskip("evo.core.metrics")
    trajectory = pytest.importorskip("evo.core.trajectory")
    true, estimated = walk(3), some_motion() @ disturbed(walk(3))
    pair = [
        trajectory.PoseTrajectory3D(poses_se3=[*poses], timestamps=np.arange(30.0))
        for poses in (true, estimated)
    ]

    def statistics(metric):
        metric.process_data(tuple(pair))
        found = metric.get_all_statistics()
        return [found[name] for name in ("rmse", "mean", "median", "max")]

    relation = metrics.PoseRelation
    for kind, ours in zip(
        (relation.translation_part, relation.rotation_angle_deg),
        step_errors(estimated, true),
        strict=True,
    ):
        theirs = statistics(metrics.RPE(kind, 1, metrics.Unit.frames))
        np.testing.assert_allclose(ours, theirs, rtol=1e-6)
    pair[1].align(pair[0])
    theirs = statistics(metrics.APE(relation.translation_part))
    np.testing.assert_allclose(position_errors(estimated, true), theirs, rtol=1e-6)
