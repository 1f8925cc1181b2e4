"""A data set of one sequence in ColoRadar's layout."""

import pytest

from jradar.recordings.capture import open_capture
from jradar.simulation.capture_writer import simulate_capture
from tests.recordings.coloradar_writer import (
    write_calib,
    write_lidar,
    write_poses,
    write_radar,
)


@pytest.fixture
def root(tmp_path):
    """A data set of one sequence, `ec_hallways_run0`, with every stream we read."""
    folder = tmp_path / "12_21_2020_ec_hallways_run0"
    write_calib(tmp_path / "calib")
    write_radar(folder)
    write_lidar(folder)
    write_poses(folder)
    return tmp_path


@pytest.fixture
def sequence(root):
    return root / "12_21_2020_ec_hallways_run0"


@pytest.fixture(scope="session")
def simulated(tmp_path_factory):
    """A simulated capture of one frame; needs rosbags."""
    pytest.importorskip("rosbags", reason="pip install jradar[ros]")
    root = tmp_path_factory.mktemp("simulated")
    return open_capture(simulate_capture("hall", 0, root, frames=1))
