"""KISS-ICP on clouds of a known motion, and scores of movers."""

import numpy as np
import pytest

from experiments.movers import mover_scores


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


def test_a_mover_is_scored_where_it_is_and_where_it_was():
    random = np.random.default_rng(0)
    body = random.uniform(-0.3, 0.3, (400, 3))
    now, before = body + [4.0, 0, 0], body + [4.0, 1.5, 0]
    wall = np.column_stack([np.full(400, 8.0), random.uniform(-3, 3, (400, 2))])
    truth = np.concatenate([now, wall])
    exact = mover_scores(truth, truth, now, [before])
    assert exact["mover_recall"] == exact["mover_f"] == 1 and exact["trail"] == 0
    smeared = mover_scores(np.concatenate([truth, before]), truth, now, [before])
    assert smeared["mover_recall"] == 1 and smeared["trail"] == 400
    lost = mover_scores(wall, truth, now, [before])
    assert lost["mover_recall"] == lost["mover_f"] == lost["trail"] == 0
    assert np.isnan(mover_scores(truth, wall, now, [before])["trail"])
