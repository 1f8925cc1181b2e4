"""The study of motion: its tables hold the errors of a simulated walk."""

import pytest

from experiments.studies import motion


def test_a_walk_in_a_corridor(tmp_path):
    pytest.importorskip("kiss_icp", reason="pip install jradar[odometry]")
    output = tmp_path / "motion.md"
    arguments = ["-o", str(output), "--scene", "corridor", "5", "--frames", "4"]
    assert motion.main(arguments) == 0
    lines = output.read_text().splitlines()
    velocity = lines[2].split(" | ")
    assert velocity[0] == "| corridor_5" and float(velocity[3].split()[0]) < 0.2
    rotations = [line.split(" | ")[2] for line in lines[6:]]
    assert rotations == ["imu", "poses", "lidar", "none"]
