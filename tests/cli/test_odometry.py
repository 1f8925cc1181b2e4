"""`jradar odometry`: a simulated walk, its errors, and what is refused."""

import numpy as np
import pytest

from jradar.cli import main
from jradar.recordings import read_tum
from jradar.simulation import simulate_sequence

FRAMES = 4


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    return simulate_sequence(
        "corridor", 5, tmp_path_factory.mktemp("walk"), frames=FRAMES
    )


def test_a_simulated_walk_is_followed(walk, tmp_path, run_json):
    path = tmp_path / "trajectory.tum"
    found = run_json("odometry", walk, "-o", path)
    assert found["rotation"] == "imu" and found["frames with a velocity"] == FRAMES
    assert found["distance (m)"] == pytest.approx(found["true distance (m)"], rel=0.15)
    assert found["APE (m)"]["rmse"] < 0.05 and found["RPE (deg)"]["max"] < 1
    poses = read_tum(path)
    np.testing.assert_allclose(np.diff(poses.stamps), 0.1, atol=0.005)
    straight = run_json("odometry", walk, "-o", path, "--rotation", "none")
    assert straight["RPE (deg)"]["mean"] > found["RPE (deg)"]["mean"]


def test_scans_tell_how_the_rig_turns(walk, tmp_path, run_json):
    pytest.importorskip("kiss_icp", reason="pip install jradar[odometry]")
    path = tmp_path / "trajectory.tum"
    found = run_json("odometry", walk, "-o", path, "--rotation", "lidar")
    assert found["APE (m)"]["rmse"] < 0.05 and found["RPE (deg)"]["max"] < 3


def test_one_frame_or_a_recording_without_times_has_no_way(
    walk, small_cube, tmp_path, capsys
):
    path = str(tmp_path / "trajectory.tum")
    assert main(["odometry", str(walk), "-o", path, "--frames", "0:1"]) == 2
    assert "expected 2 or more" in capsys.readouterr().err
    assert main(["odometry", small_cube, "-o", path]) == 2
    assert not (tmp_path / "trajectory.tum").exists()
