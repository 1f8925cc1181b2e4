"""Poses against closed forms: a steady turn, drawn quaternions, the ends."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jradar.lidar import Poses, interpolate_poses, rigid_transform, transform


def turning(times, rate, speed):
    """Poses that turn about z and drive along x at constant rates, from time 100."""
    times = np.asarray(times, float)
    half = rate * times / 2
    zero = 0 * times
    return Poses(
        100 + times,
        np.stack([speed * times, zero, zero + 1], -1),
        np.stack([zero, zero, np.sin(half), np.cos(half)], -1),
    )


def test_a_pose_is_the_rotation_of_its_quaternion_and_then_its_place():
    rng = np.random.default_rng(0)
    quaternion, xyz = rng.normal(size=(3, 4, 4)), rng.normal(size=(3, 4, 3))
    matrix = rigid_transform(xyz, quaternion)
    expected = np.tile(np.eye(4), (3, 4, 1, 1))
    turns = Rotation.from_quat(quaternion.reshape(-1, 4))
    expected[..., :3, :3] = turns.as_matrix().reshape(3, 4, 3, 3)
    expected[..., :3, 3] = xyz
    np.testing.assert_allclose(matrix, expected, atol=1e-12)
    points = rng.normal(size=(5, 3)).astype(np.float32)
    moved = transform(matrix[0, 0], points)
    assert moved.dtype == np.float32
    np.testing.assert_allclose(moved, turns[0].apply(points) + xyz[0, 0], atol=1e-6)
    assert transform(matrix[0, 0], points[:0]).shape == (0, 3)


@pytest.mark.parametrize("rate", [0.0, 0.3, -2.0])
def test_between_poses_of_a_steady_turn_whatever_their_quaternions_signs(rate):
    poses = turning([0, 0.1, 0.35, 1.0], rate, speed=2.0)
    poses = poses._replace(quaternion=poses.quaternion * [[1], [-1], [1], [-1]])
    wanted = np.array([0, 0.02, 0.1, 0.2, 0.6, 0.99, 1.0])
    found = interpolate_poses(poses, 100 + wanted)
    turns = Rotation.from_rotvec(np.outer(rate * wanted, [0, 0, 1])).as_matrix()
    np.testing.assert_allclose(found[:, :3, :3], turns, atol=1e-9)
    places = np.outer(2 * wanted, [1, 0, 0]) + [0, 0, 1]
    np.testing.assert_allclose(found[:, :3, 3], places, atol=1e-9)


@pytest.mark.parametrize(
    ("xyz", "quaternion"),
    [([0, 0, 0], [0] * 4), ([0, 0, np.nan], [0, 0, 0, 1]), ([0, 0, 0], [np.inf] * 4)],
)
def test_what_is_no_pose_is_refused(xyz, quaternion):
    with pytest.raises(ValueError, match="expected finite numbers and a quaternion"):
        rigid_transform(np.array(xyz, float), np.array(quaternion, float))


def test_outside_the_trajectory_is_nan():
    poses = turning([0, 1], 0.1, speed=1.0)
    stamps = np.array([99.999, 100, 100.5, 101, 101.001, np.nan])
    finite = np.isfinite(interpolate_poses(poses, stamps)).all((1, 2))
    assert finite.tolist() == [False, True, True, True, False, False]
    assert interpolate_poses(poses, np.array([0.0])).shape == (1, 4, 4)
    assert interpolate_poses(poses, np.zeros(0)).shape == (0, 4, 4)


def test_stamps_of_today_keep_their_microseconds():
    poses = turning([0, 1], 0.0, speed=1.0)
    poses = poses._replace(stamps=poses.stamps + 1.6e9)
    found = interpolate_poses(poses, np.array([1.6e9 + 100.123456]))
    assert found[0, 0, 3] == pytest.approx(0.123456, abs=1e-6)


@pytest.mark.parametrize("times", [[0.0], [0, 1, 1], [0, 2, 1], []])
def test_times_that_do_not_rise_are_refused(times):
    with pytest.raises(ValueError, match="expected 2 or more at rising times"):
        interpolate_poses(turning(times, 1.0, 1.0), np.array([100.0]))
