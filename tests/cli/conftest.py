"""What the tests of the command line share: a tiny model, small recordings, runners."""

import json

import jax
import numpy as np
import pytest

from jradar.cli import main
from jradar.model import save_model
from jradar.radar import RadarSpec, simulate_cube
from jradar.simulation import simulate_sequence
from tests.calibration.test_self_calibration import CHIP, channels, scatterers
from tests.models import tiny_map_model, tiny_model
from tests.recordings.small_sequence import room_echoes

MODEL = tiny_model()
QUICK = ("--draws", "2", "--steps", "1")  # the same program in every test


@pytest.fixture
def run_json(capsys):
    """Run a command that succeeds and return its result."""

    def run(*arguments):
        assert main([*map(str, arguments), "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    return run


@pytest.fixture
def refused(capsys):
    """Run a command that fails, and return its one line."""

    def run(*arguments, code=2):
        try:
            found = main([*map(str, arguments)])
        except SystemExit as stop:  # of the parser
            found = stop.code
        out, err = capsys.readouterr()
        lines = err.replace("jradar: compiling ..\n", "").splitlines()
        shown = [line for line in lines if line.startswith("jradar")]
        assert found == code and not out and len(shown) == 1, err
        assert "Traceback" not in err
        return shown[0]

    return run


@pytest.fixture(scope="session")
def model_folder(tmp_path_factory):
    """The folder of a random diffusion model."""
    folder = tmp_path_factory.mktemp("models") / "tiny"
    save_model(folder, MODEL)
    return str(folder)


@pytest.fixture(scope="session")
def map_model_folder(tmp_path_factory):
    """The folder of a random model of maps."""
    folder = tmp_path_factory.mktemp("models") / "maps"
    save_model(folder, tiny_map_model())
    return str(folder)


@pytest.fixture(scope="session")
def small_cube(tmp_path_factory):
    """A simulated frame of a radar that measures elevation, as cube.npy."""
    return write_cube(tmp_path_factory.mktemp("cube"), "awr1843")


@pytest.fixture(scope="session")
def flat_cube(tmp_path_factory):
    """The same room seen by a radar with one row of antennas."""
    return write_cube(tmp_path_factory.mktemp("flat"), "awr1642")


@pytest.fixture(scope="session")
def walk(tmp_path_factory):
    """A simulated walk of four frames."""
    return simulate_sequence("corridor", 5, tmp_path_factory.mktemp("walk"), frames=4)


@pytest.fixture(scope="session")
def uncalibrated(tmp_path_factory):
    """A few frames of an uncalibrated radar, as cube.npy."""
    folder = tmp_path_factory.mktemp("uncalibrated")
    response = channels(CHIP, 25).reshape(3, 4, 1, 1).astype(np.complex64)
    cubes = (simulate_cube(jax.random.key(k), scatterers(k), CHIP) for k in range(6))
    cubes = [cube * response for cube in cubes]
    noise = np.random.default_rng(0).standard_normal((2, 6, *CHIP.cube_shape))
    np.save(folder / "cube.npy", np.stack(cubes) + 5 * (noise[0] + 1j * noise[1]))
    (folder / "radar.toml").write_text(
        '[radar]\ndevice = "awr1843"\nnum_chirps = 16\nnum_samples = 128\n'
        '[file]\naxes = ["frame", "tx", "rx", "chirp", "sample"]\n'
        "[calibration]\nrange_bias_m = 0.05\n"
    )
    return folder / "cube.npy"


def write_cube(folder, device, *, silent=False, **waveform):
    """Write cube.npy with radar.toml; return its path."""
    size = {"num_chirps": 32, "num_samples": 64} | waveform
    radar = RadarSpec.named(device, **size)
    echoes = room_echoes(np.random.default_rng(0))
    cube = simulate_cube(jax.random.key(0), echoes, radar, noise_power=100.0)
    np.save(folder / "cube.npy", np.asarray(cube) * (not silent))
    lines = [f"{name} = {value}" for name, value in size.items()]
    text = "\n".join(["[radar]", f'device = "{device}"', *lines])
    (folder / "radar.toml").write_text(text + "\n")
    return str(folder / "cube.npy")
