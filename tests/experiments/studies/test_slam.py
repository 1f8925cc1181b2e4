"""KISS-ICP on clouds of a known motion."""

import numpy as np
import pytest


def test_matched_clouds_of_a_room_tell_its_motion():
    pytest.importorskip("kiss_icp", reason="pip install jradar[odometry]")
    from experiments.studies.slam import kiss_icp_poses

    random = np.random.default_rng(0)
    room = random.uniform(-5, 5, (6000, 3)) * [1, 1, 0.3]
    point, wall = np.arange(6000), np.arange(6000) % 3
    side = np.array([5.0, 5.0, 1.5])[wall]
    room[point, wall] = np.sign(room[point, wall]) * side
    steps = np.arange(6) * 0.05
    clouds = [room - [step, 0, 0] for step in steps]
    poses = kiss_icp_poses([*clouds, np.zeros((3, 3))])
    np.testing.assert_allclose(poses[:6, 0, 3], steps, atol=0.02)
    np.testing.assert_array_equal(poses[6], poses[5])  # too few points to match
