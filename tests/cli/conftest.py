"""What the tests of the command line share: a tiny model, a small radar, one runner."""

import json

import jax
import numpy as np
import pytest

from jradar.cli import main
from jradar.diffusion import UNet
from jradar.model import save_model
from jradar.radar import RadarSpec, simulate_cube
from tests.models import tiny_model
from tests.recordings.small_sequence import room_echoes

NETWORK = UNet(channels=4, multipliers=(1,), blocks=1, attention_levels=(), stem=(1, 4))
MODEL = tiny_model(network=NETWORK)


@pytest.fixture
def run_json(capsys):
    """Run a command that succeeds and return its result."""

    def run(*arguments):
        assert main([*map(str, arguments), "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    return run


@pytest.fixture(scope="session")
def model_folder(tmp_path_factory):
    """The folder of a random diffusion model."""
    folder = tmp_path_factory.mktemp("models") / "tiny"
    save_model(folder, MODEL)
    return str(folder)


@pytest.fixture(scope="session")
def small_cube(tmp_path_factory):
    """A simulated frame of a radar that measures elevation, as cube.npy."""
    return write_cube(tmp_path_factory.mktemp("cube"), "awr1843")


@pytest.fixture(scope="session")
def flat_cube(tmp_path_factory):
    """The same room seen by a radar with one row of antennas."""
    return write_cube(tmp_path_factory.mktemp("flat"), "awr1642")


def write_cube(folder, device, **waveform):
    size = {"num_chirps": 32, "num_samples": 64} | waveform
    radar = RadarSpec.named(device, **size)
    echoes = room_echoes(np.random.default_rng(0))
    cube = simulate_cube(jax.random.key(0), echoes, radar, noise_power=100.0)
    np.save(folder / "cube.npy", np.asarray(cube))
    lines = [f"{name} = {value}" for name, value in size.items()]
    text = "\n".join(["[radar]", f'device = "{device}"', *lines])
    (folder / "radar.toml").write_text(text + "\n")
    return str(folder / "cube.npy")
