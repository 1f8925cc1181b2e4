"""Pipes, devices and huge files are refused at once, wherever a path is read."""

import os

import jax
import numpy as np
import pytest
import safetensors.numpy

from jradar.diffusion import read_params
from jradar.errors import ModelError, UsageError
from jradar.files import open_file, read_json, read_text
from jradar.model import load_model, save_model
from jradar.recordings import describe_file, open_recording, read_description
from jradar.recordings.clouds.read import read_bin
from jradar.recordings.coloradar.files import read_stamps, read_transform
from tests.models import tiny_model
from tests.recordings.dca1000_writer import CFG

pytestmark = pytest.mark.timeout(100)  # a reader that waits for a pipe never ends


@pytest.fixture(params=["pipe", "device"])
def special(request, tmp_path):
    """A function that puts a pipe, or a link to an endless device, at a path."""

    def put(*parts):
        path = tmp_path.joinpath(*parts)
        path.parent.mkdir(exist_ok=True)
        if request.param == "pipe":
            os.mkfifo(path)
        else:
            path.symlink_to("/dev/zero")
        return path

    return put


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("a.json", read_json),
        ("a.toml", read_text),
        *((f"a.{kind}", read_description) for kind in ("toml", "cfg", "txt", "json")),
        *((f"a.{kind}", open_recording) for kind in ("npy", "pcap", "bag", "mcap")),
        *((f"a.{kind}", describe_file) for kind in ("bag", "db3")),
        ("part.db3", lambda path: describe_file(path.parent)),
        ("a.bin", read_bin),
        ("timestamps.txt", lambda path: read_stamps(path, [])),
        ("base_to_lidar.txt", read_transform),
    ],
)
def test_pipes_and_devices_are_refused(special, name, read):
    path = special("data", name)
    (path.parent / "metadata.yaml").touch()
    with pytest.raises(UsageError, match=f"{name} is a pipe or a device, expected a f"):
        read(path)


def test_the_limit_is_checked_before_reading(tmp_path):
    path = tmp_path / "a.toml"
    with path.open("wb") as file:
        file.truncate(1 << 40)  # takes no room on the disk
    for read in (read_text, read_description, lambda path: open_file(path, limit=9)):
        with pytest.raises(ValueError, match="a.toml holds 1,099,511,627,776 bytes"):
            read(path)
    with pytest.raises(ValueError, match="1,099,511,627,776 bytes, .* most 67,108,864"):
        read_stamps(path, [])
    path.rename(tmp_path / "metadata.yaml")
    with pytest.raises(ValueError, match="yaml holds 1,099,511,627,776 bytes, expect"):
        describe_file(tmp_path)


def test_a_radar_whose_frames_are_too_many(tmp_path):
    (tmp_path / "radar.cfg").write_text(CFG.replace("0 2 5 0 100", "0 0 1 0 100"))
    with (tmp_path / "adc_data.bin").open("wb") as file:
        file.truncate(1 << 36)
    with pytest.raises(ValueError, match="adc_data.bin holds 429,496,729 frames"):
        open_recording(tmp_path / "adc_data.bin", allow_partial=True)


def test_weights_of_another_size_are_refused_before_their_digest(tmp_path):
    save_model(tmp_path / "model", tiny_model())
    with (tmp_path / "model" / "weights.safetensors").open("r+b") as file:
        file.truncate(1 << 40)
    with pytest.raises(ModelError, match="weights.safetensors holds 1,099,511,627,776"):
        load_model(tmp_path / "model")


def test_names_of_thousands_of_parts_are_refused(tmp_path):
    path = tmp_path / "weights.safetensors"
    name = "/".join(["a"] * 3000)
    safetensors.numpy.save_file({name: np.ones(3, np.float32)}, path)
    with pytest.raises(ValueError, match="weights.* a name of 3,000 parts"):
        jax.tree.leaves(read_params(path))
