"""A data set of one sequence in ColoRadar's layout."""

import pytest

from jradar.recordings.capture import open_capture
from jradar.simulation.capture_writer import simulate_capture
from tests.recordings import coloradar_writer


@pytest.fixture
def root(tmp_path):
    """A data set of one sequence, `ec_hallways_run0`, with every stream we read."""
    folder = tmp_path / "12_21_2020_ec_hallways_run0"
    coloradar_writer.write_calib(tmp_path / "calib")
    coloradar_writer.write_radar(folder)
    coloradar_writer.write_lidar(folder)
    coloradar_writer.write_poses(folder)
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
