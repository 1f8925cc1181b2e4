"""`jradar odometry`: a simulated walk, its errors, and what is refused."""

import numpy as np
import pytest

from jradar.recordings import read_tum


@pytest.mark.slow
def test_a_simulated_walk_is_followed(walk, tmp_path, run_json):
    path = tmp_path / "trajectory.tum"
    found = run_json("odometry", walk, "-o", path)
    assert found["rotation"] == "imu" and found["frames_with_a_velocity"] == 4
    assert found["distance_m"] == pytest.approx(found["true_distance_m"], rel=0.15)
    assert found["ape_m"]["rmse"] < 0.05 and found["rpe_deg"]["max"] < 1
    poses = read_tum(path)
    np.testing.assert_allclose(np.diff(poses.stamps), 0.1, atol=0.005)
    straight = run_json("odometry", walk, "-o", path, "--rotation", "none")
    assert straight["rpe_deg"]["mean"] > found["rpe_deg"]["mean"]


def test_scans_show_how_the_rig_turns(walk, tmp_path, run_json):
    pytest.importorskip("kiss_icp", reason="pip install jradar[odometry]")
    path = tmp_path / "trajectory.tum"
    found = run_json("odometry", walk, "-o", path, "--rotation", "lidar")
    assert found["ape_m"]["rmse"] < 0.05 and found["rpe_deg"]["max"] < 3


def test_a_trajectory_needs_two_frames_and_times(walk, small_cube, tmp_path, refused):
    path = tmp_path / "trajectory.tum"
    found = refused("odometry", walk, "-o", path, "--frames", "0:1")
    assert "expected 2 or more" in found
    refused("odometry", small_cube, "-o", path)
    assert not path.exists()
