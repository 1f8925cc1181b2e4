"""Records that several experiments' tests train on and score."""

import pytest

from experiments import build
from experiments.configs import default
from jradar.data import PrepareSpec, prepare
from jradar.lidar import LidarSpec
from tests.recordings.small_sequence import write_sequence, write_splits


@pytest.fixture(scope="session")
def records(tmp_path_factory):
    """Prepared frames of a small room, with the field of view of the configs."""
    source, folder = (tmp_path_factory.mktemp(name) for name in ("source", "records"))
    splits = {"a": "train", "b": "validation", "c": "test"}
    for seed, (name, frames) in enumerate({"a": 8, "b": 2, "c": 2}.items()):
        write_sequence(source, name, frames=frames, seed=seed)
    write_splits(source, splits)
    view = build.view(default.get_config().image)
    prepare(source, folder, PrepareSpec(lidar=LidarSpec(**view)), workers=1)
    return folder
