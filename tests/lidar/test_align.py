"""Poses against closed forms: a steady turn, drawn quaternions, the ends."""

import math

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


def test_rotation_of_any_quaternion():
    rng = np.random.default_rng(0)
    quaternion, xyz = rng.normal(size=(3, 4, 4)), rng.normal(size=(3, 4, 3))
    matrix = rigid_transform(xyz, quaternion)
    expected = np.tile(np.eye(4), (3, 4, 1, 1))
    turns = Rotation.from_quat(quaternion.reshape(-1, 4)).as_matrix()
    expected[..., :3, :3], expected[..., :3, 3] = turns.reshape(3, 4, 3, 3), xyz
    np.testing.assert_allclose(matrix, expected, atol=1e-12)


def test_a_quarter_turn_to_the_left():
    half = math.sqrt(0.5)
    a_from_b = rigid_transform(np.array([1.0, 2, 3]), np.array([0, 0, half, half]))
    moved = transform(a_from_b, np.array([[1, 0, 0], [0, 1, 0]], np.float32))
    assert moved.dtype == np.float32
    np.testing.assert_allclose(moved, [[1, 3, 3], [0, 2, 3]], atol=1e-6)
    assert transform(a_from_b, np.zeros((0, 3), np.float32)).shape == (0, 3)


def test_transforms_chain():
    rng = np.random.default_rng(1)
    poses = rigid_transform(rng.normal(size=(2, 3)), rng.normal(size=(2, 4)))
    a_from_b, b_from_c = poses
    points = rng.normal(size=(5, 3))
    moved = transform(a_from_b, transform(b_from_c, points))
    np.testing.assert_allclose(transform(a_from_b @ b_from_c, points), moved)
    back = transform(np.linalg.inv(a_from_b @ b_from_c), moved)
    np.testing.assert_allclose(back, points, atol=1e-12)


@pytest.mark.parametrize(
    ("xyz", "quaternion"),
    [
        ([0, 0, 0], [0, 0, 0, 0]),
        ([0, 0, np.nan], [0, 0, 0, 1]),
        ([0, 0, 0], [np.inf] * 4),
    ],
)
def test_what_is_no_pose_is_refused(xyz, quaternion):
    with pytest.raises(ValueError, match="expected finite numbers and a quaternion"):
        rigid_transform(np.array(xyz, float), np.array(quaternion, float))


@pytest.mark.parametrize("rate", [0.0, 0.3, -2.0])
def test_between_poses_of_a_steady_turn(rate):
    poses = turning([0, 0.1, 0.35, 1.0], rate, speed=2.0)
    wanted = np.array([0, 0.02, 0.1, 0.2, 0.6, 0.99, 1.0])
    found = interpolate_poses(poses, 100 + wanted)
    for matrix, time in zip(found, wanted, strict=True):
        angle = rate * time
        turn = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
        np.testing.assert_allclose(matrix[:2, :2], turn, atol=1e-9)
        np.testing.assert_allclose(matrix[:3, 3], [2 * time, 0, 1], atol=1e-9)


def test_the_sign_of_a_quaternion_does_not_matter():
    poses = turning([0, 0.5, 1.0], 1.0, speed=0.0)
    flipped = poses._replace(quaternion=poses.quaternion * [[1], [-1], [1]])
    times = np.linspace(100, 101, 9)
    np.testing.assert_allclose(
        interpolate_poses(poses, times), interpolate_poses(flipped, times), atol=1e-12
    )


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
