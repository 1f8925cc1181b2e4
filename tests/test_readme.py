"""What the documents show works: Python and TOML here, shell commands parse and run."""

import argparse
import contextlib
import importlib
import os
import re
import shlex
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from experiments import main as experiments_main
from experiments.demo import EXPECTED
from jradar.cli import options
from jradar.cli.commands import simulate
from jradar.recordings import open_recording, read_description
from tests.programs import pasted, ran

ROOT = Path(__file__).parents[1]
GUIDE, STREAM = "jradar/recordings/README", "jradar/stream/README"
RIG = "jradar/data/README"
LAB = tuple(f"experiments/lab/{part}" for part in ("maps", "simulation"))
EXPERIMENTS = "experiments/README", "experiments/RESULTS", *LAB
FILES = "README", GUIDE, STREAM, RIG, *EXPERIMENTS, "benchmarks/README"
TEXTS = {name: (ROOT / f"{name}.md").read_text() for name in FILES}
README = TEXTS["README"]


def blocks(language, name="README"):
    return re.findall(rf"```{language}\n(.*?)```", TEXTS[name], re.DOTALL)


def commands():
    """(file, command) of every line of every shell block, without its comment."""
    for name in FILES:
        for block in blocks("bash", name):
            for line in block.splitlines():
                command = re.sub(r"\s+#.*", "", line).strip()
                if command and not command.startswith(
                    ("python3 -m venv", "source ", "git clone", "ros2 ", "mkdir ")
                ):
                    yield name, command


COMMANDS = [*dict.fromkeys(command for _, command in commands())]


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """A folder in which sim/hall_0, also known as lab_0 and corridor_0, is one."""
    pytest.importorskip("embreex")
    folder = tmp_path_factory.mktemp("readme")
    arguments = ["simulate", "--scene", "hall", "--frames", "2"]
    simulate(options.parser().parse_args([*arguments, "-o", str(folder / "sim")]))
    (found,) = (folder / "sim").glob("hall_*")
    for name in ("lab_0", "corridor_0"):
        (folder / "sim" / name).symlink_to(found)
    return folder


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_every_line_of_the_readme_runs_in_order(tmp_path):
    """Pasted into one shell, in a fresh copy and a fresh environment.

    All but the second command of the set-up, which runs these tests.
    """
    pytest.importorskip("embreex")
    clone = tmp_path / "jradar"
    left = shutil.ignore_patterns(".*", "runs", "*.egg-info", "__pycache__")
    shutil.copytree(ROOT, clone, ignore=left)
    lines = [re.findall(r"```bash\n(.*)\n```", README)[0]]
    use = README.split("## Use it")[1]
    for language, block in re.findall(r"```(bash|python)\n(.*?)```", use, re.DOTALL):
        block = block.replace("jradar view", "jradar view --no-open")
        lines += [f"python - <<'END'\n{block}END" if language == "python" else block]
    script = "\n".join(lines)
    assert script.count("\njradar ") == 12 and "experiments.main" in script
    ours = ("PYTHON", "JAX", "XLA", "JRADAR")  # of the process that tests
    environment = {k: v for k, v in os.environ.items() if not k.startswith(ours)}
    shown = pasted(lines, clone, environment)
    for row in ("jradar-sim, one pass", "splat", "OS-CFAR"):  # as the demo says
        found = re.search(rf"\| {row} \|[^|]*\|[^|]*\|[^|]*\| ([0-9.]+)", shown)
        expected = re.search(rf"([0-9]+) % for `?{row}", EXPECTED)
        assert float(found[1]) == pytest.approx(float(expected[1]), abs=2)
    written = {path.name for path in clone.iterdir()}
    expected = {"out", "my.toml", "points", "walk.tum", "records", "map"}
    assert expected | {"enhance.jax"} <= written


def run_blocks(name):
    """The names that the blocks of Python in a file leave behind."""
    names = {}
    for code in blocks("python", name):
        exec(code, names)
    return names


def test_five_lines_turn_a_recording_into_a_dense_cloud(simulated):
    """In a fresh interpreter, as a newcomer runs them."""
    (code,) = blocks("python")
    assert len([line for line in code.splitlines() if line]) == 5
    code += "print(int(cloud.valid.sum()), float(cloud.xyz[cloud.valid][:, 0].min()))"
    points, nearest = ran([sys.executable, "-c", code], simulated).split()
    assert int(points) > 1000 and float(nearest) > 0


def test_the_readme_is_short():
    assert len(README.split()) <= 900


@pytest.mark.slow
def test_five_compositions_run_as_they_stand(simulated, monkeypatch):
    monkeypatch.chdir(simulated)
    found = []
    for code in blocks("python", "experiments/README"):
        if "get_config" not in code:  # see test_own_network
            exec(code, names := {})
            found.append(names)
    chamfer, many, own, trained, other = found
    assert -1 < chamfer["slope"].min() and chamfer["slope"].max() < 0
    assert (many["clouds"].valid.sum(1) > 1000).all()
    assert own["cloud"].valid.sum() > 1000 > own["points"].valid.sum() > 0
    assert len(trained["losses"]) == 10 and trained["losses"][-1] < trained["losses"][0]
    np.testing.assert_allclose(other["strongest"], [8, 2, 0], atol=0.1)


def test_a_recording_is_opened_and_a_frame_becomes_a_view(simulated, monkeypatch):
    monkeypatch.chdir(simulated)
    names = run_blocks(GUIDE)
    assert names["cube"].shape == names["recording"].radar.spec.cube_shape
    assert names["cloud"].valid.any() and len(names["scan"]) > 1000
    names = run_blocks(STREAM)
    assert len(names["points"]) == names["frame"].clouds["radar"].valid.sum() > 0


def test_a_case_of_ones_own_is_timed(capsys):
    run_blocks("benchmarks/README")
    median, peer, ratio = capsys.readouterr().out.split()
    assert peer == "NumPy" and float(median) > 0 and float(ratio) > 0


def test_toml_example_is_a_radar(tmp_path):
    path = tmp_path / "radar.toml"
    path.write_text(blocks("toml", GUIDE)[0])
    assert read_description(path).radar.cube_shape == (3, 4, 64, 128)


def test_the_example_of_a_capture_has_known_keys_and_says_what_is_missing(tmp_path):
    text = blocks("toml", GUIDE)[1]
    (tmp_path / "capture.toml").write_text(text)
    with pytest.raises(FileNotFoundError, match=r"profile\.cfg|adc_data\.bin"):
        open_recording(tmp_path)


def test_two_commands_do_all_the_set_up():
    section = README.split("## Run it")[1].split("\n## ")[0]
    commands = re.findall(r"```bash\n(.*)\n```", section)
    assert len(commands) == 2 and "configs/demo.py" in commands[0]
    for command in commands:
        assert command.startswith("python3 -m venv .venv && .venv/bin/pip install")


def test_links_lead_to_files():
    for name, text in TEXTS.items():
        for target in re.findall(r"\]\((?!http)([^)#]+)\)", text):
            assert (ROOT / name).parent.joinpath(target).exists(), f"{name}: {target}"


def words_of(command):
    """The program's arguments, and the variables set before it."""
    words = shlex.split(command)
    count = next(i for i, w in enumerate(words) if not re.match(r"[A-Z_]+=", w))
    return words[count:], dict(word.split("=", 1) for word in words[:count])


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_parses(command, monkeypatch):
    words, _ = words_of(command)
    if words[0] == "jradar":
        options.parser().parse_args(words[1:])
        return
    assert words[:2] == ["python", "-m"], command
    module, arguments = words[2], words[3:]
    if module == "experiments.main":
        given = dict(word[2:].split("=", 1) for word in arguments)
        assert {"config", "workdir"} <= given.keys()
        assert (ROOT / given["config"]).exists()
        path = given.pop("config").removesuffix(".py").replace("/", ".")
        known = experiments_main.config_keys(importlib.import_module(path).get_config())
        allowed = {"workdir", "mode", "seeds", *(f"config.{key}" for key in known)}
        assert given.keys() <= allowed
        return
    seen = []
    parse = argparse.ArgumentParser.parse_args

    def stop(parser, given=None, namespace=None):
        seen.append(parse(parser, given, namespace))
        raise KeyboardInterrupt

    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", stop)
    loaded = importlib.import_module(module)
    with contextlib.suppress(KeyboardInterrupt):
        loaded.main(arguments)
    assert seen


STANDS_FOR = {  # of the user's own
    "RECORDING": "sim/hall_0",
    "RECORDINGS": "sim",
    "PATH": "sim/hall_0",
    "walk.bag": "walk.ros2",
    "adc_data.bin": "capture/hall_0/adc_data.bin",
    "profile.cfg": "capture/hall_0/awr1843.cfg",
    "coloradar/12_21_2020_ec_hallways_run0": "sim/hall_0",
}
NOT_RUN = {  # and why
    "python -m benchmarks.run": "half an hour; the quick one is run",
    "--scheduler": "needs a Dask cluster",
    "python -m benchmarks.soak_stream --seconds 600 --model jradar-sim": "10 minutes",
    "--host 127.0.0.1 --card 127.0.0.2": "waits for a card; see test_streaming",
    "--repeat": "sends until it is ended",
    "--board": "needs a radar",
    "--points /dev/ttyACM1": "needs a radar",
    "JAX_COORDINATOR_ADDRESS": "needs two machines; see test_processes",
    "--seeds": "minutes; see test_main",
    "--config=experiments/configs/default.py": "an hour of training",
    "--config=experiments/configs/regression.py": "an hour of training",
    "--config=experiments/configs/from_regression.py": "starts from that",
    "--rates RECORDS_OF_SIM_5": "needs that set",
    "--data runs/sim5": "needs that set",
    "--config=experiments/configs/coloradar.py": "days of training",
    "--config=experiments/configs/maps.py": "hours of training",
    "--model runs/maps": "needs that run",
    "-m experiments.places": "hours; needs ColoRadar's maps",
    "--config.data.path=runs/sim5": "needs that set",
    "-m experiments.studies.histories": "needs jradar-sim-6",
    "-m experiments.studies.loops": "half an hour; needs a walk of 300 m",
    "--scene hallways --frames 3000": "ten minutes; 5.5 GB",
    "calibrate sim/hallways_0": "needs that walk",
    "--config.data.path=runs/sim6": "needs that set",
    "-m experiments.studies.map_views": "half an hour; needs ColoRadar's maps",
    "-m experiments.studies.real_points": "needs a walk of points with poses",
    "-o records_astyx": "needs Astyx's frames",
    "finetune records_astyx": "needs those records",
    "-o scores_astyx": "needs those records",
    "--config.data.path=runs/views": "needs those views",
    "--split test --model jradar-sim": "needs that set",
    "--model runs/half": "needs that run",
    "--config=experiments/configs/radarhd.py": "hours of training",
    "--config=experiments/configs/radarhd_history.py": "needs RadarHD's folder",
    "--config=experiments/configs/radarhd_nearness.py": "needs RadarHD's folder",
}


@pytest.mark.slow
@pytest.mark.hours
@pytest.mark.timeout(3600)
def test_commands_run_one_after_another(tmp_path):
    """In one folder; those of the experiments first, whose runs the others need.

    Compiled as for a user: programs that the tests compile quickly train slowly.
    """
    pytest.importorskip("embreex")
    program = Path(sys.executable).parent
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "JRADAR_CACHE": ""}
    del environment["XLA_FLAGS"]
    for name in ("experiments", "benchmarks"):
        (tmp_path / name).symlink_to(ROOT / name)

    def run(words):
        ran([str(program / words[0]), *words[1:]], tmp_path, environment)

    def simulated(*arguments):
        run(["python", "-m", "jradar", "simulate", *arguments])

    simulated("--scene", "hall", "--frames", "3", "-o", "sim")
    simulated(*"--scene hall --frames 3 --format capture -o capture".split())
    simulated("--set", "jradar-sim-1-mini", "--frames", "2", "-o", "coloradar")
    run("python -m jradar enhance sim/hall_0 -o walk.ros2".split())
    shown = [each for each in commands() if each[0] != RIG]
    shown.sort(key=lambda each: not each[0].startswith("exp"))
    number = 0
    for command in dict.fromkeys(command for _, command in shown):
        if any(command == k or (k[0] == "-" and k in command) for k in NOT_RUN):
            continue
        words, variables = words_of(command)
        if variables:
            continue
        words = [STANDS_FOR.get(word, word) for word in words]
        if words[0] == "jradar":
            words = ["python", "-m", "jradar", *words[1:]]
            words += ["--no-open"] if "view" in words else []
        run(words)
        number += 1
    assert number > 15


@pytest.mark.slow
@pytest.mark.hours
@pytest.mark.timeout(1800)
def test_recordings_become_a_model_of_ones_own(tmp_path):
    """The commands of the guide to it, pasted into one shell."""
    pytest.importorskip("embreex")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = {**os.environ, "PATH": path, "JRADAR_CACHE": ""}
    del environment["XLA_FLAGS"]
    (lines,) = blocks("bash", RIG)
    shown = pasted(lines.splitlines(), tmp_path, environment)
    assert "mine" in shown.split("home_903")[-1]
    assert any((tmp_path / "out").iterdir())
