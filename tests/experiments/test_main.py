"""Experiments: a killed run ends like an uninterrupted one; flags; every config."""

import importlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from experiments import build, radarhd
from experiments.configs import default
from jradar.data import PrepareSpec, Records, prepare
from jradar.lidar import LidarSpec
from tests.data.small_sequence import write_sequence, write_splits

ROOT = Path(__file__).parents[2]
CONFIGS = sorted((ROOT / "experiments" / "configs").glob("[!_]*.py"))
SMALL = [
    "--config.image.coarse=(8, 8)",
    "--config.image.fine=(16, 64)",
    "--config.network.channels=8",
    "--config.evaluation.detectors=('os',)",
    "--config.train.batch_size=4",
    "--config.train.steps=24",
    "--config.train.checkpoint_every=8",
    "--config.sampling.steps=3",
]


@pytest.fixture(scope="module")
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


def start(workdir, *flags, config="smoke", cache=None):
    """Run an experiment in a process of its own; `cache` keeps what it compiles."""
    environment = {**os.environ}
    if cache:
        environment |= {"XDG_CACHE_HOME": str(cache), "JRADAR_CACHE": ""}
    command = [sys.executable, "-m", "experiments.main"]
    command += [f"--config=experiments/configs/{config}.py", f"--workdir={workdir}"]
    return subprocess.Popen(
        [*command, *flags],
        cwd=ROOT,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process):
    out, err = process.communicate(timeout=280)
    return process.returncode, out, err


def losses(workdir):
    lines = (workdir / "metrics.jsonl").read_text().splitlines()
    return [(line["step"], line["loss"]) for line in map(json.loads, lines)]


@pytest.mark.timeout(900)
def test_killed_run_ends_with_the_losses_of_an_uninterrupted_one(records, tmp_path):
    small = [*SMALL, f"--config.data.path={records}"]
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    cache = {"cache": tmp_path / "cache"}
    process = start(killed, *small, **cache)
    steps = killed / "checkpoints"
    deadline = time.monotonic() + 200
    while not (steps.exists() and any(p.name == "8" for p in steps.iterdir())):
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    assert finish(process)[0] == -signal.SIGKILL
    assert not (killed / "bundle").exists()
    assert any((tmp_path / "cache" / "jradar").iterdir())

    code, out, err = finish(start(killed, *small, **cache))
    assert code == 0, err
    code, _, err = finish(start(whole, *small, **cache))
    assert code == 0, err
    assert losses(killed) == losses(whole) and len(losses(whole)) == 24
    assert (killed / "evaluation" / "table.md").read_text() == (
        whole / "evaluation" / "table.md"
    ).read_text()
    assert "smoke test" in out and "one-step estimate" in out
    assert (killed / "evaluation" / "samples.png").stat().st_size > 10_000
    card = json.loads((killed / "model_card.json").read_text())
    assert card["steps"] == 24 and card["config"]["train"]["batch_size"] == 4
    assert card["data_digest"] == Records(records, "train").digest

    for change, message in (
        ("--config.train.learning_rate=0.1", "train.learning_rate was 0.0005, now 0.1"),
        ("--config.seed=1", "seed was 0, now 1"),
    ):
        code, out, err = finish(start(killed, *small, change))
        assert code == 2 and message in err


@pytest.mark.parametrize(
    ("flags", "code", "message"),
    [
        (["--config.train.step=3"], 2, "'train.step', did you mean train.steps?"),
        (["--config.trian.steps=3"], 2, "'trian.steps', did you mean train.steps?"),
        (["--config.train.steps=many"], 2, "many"),
        (["--mode=fly"], 2, "fly"),
        (["stray"], 2, "unexpected argument 'stray'"),
        (["--config.network.preset=huge"], 2, "network.preset = 'huge', expected one"),
        (["--mode=eval"], 5, "no weights at"),
    ],
)
def test_fault_is_one_line_with_its_code(tmp_path, flags, code, message):
    found, out, err = finish(start(tmp_path / "new", *flags))
    assert (found, out) == (code, "") and message in err
    assert err.count("\n") == 1 and "Traceback" not in err
    assert not (tmp_path / "new" / "config.json").exists()


def test_missing_config_is_named(tmp_path):
    code, _, err = finish(start(tmp_path, config="nothing"))
    assert code == 2 and "nothing.py" in err and "Traceback" not in err


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_config_is_buildable_and_its_record_names_its_command(records, path):
    module = importlib.import_module(f"experiments.configs.{path.stem}")
    config = module.get_config()
    if config.task == "radarhd":
        network, _ = radarhd.build_network(config)
        assert network.outputs == 1
    elif config.task == "pretrain":
        main = default.get_config()
        for name in ("network", "noise"):  # a prior is of no use with others
            assert config[name].to_dict() == main[name].to_dict()
        assert build.build_network(config.network).outputs == 2
    else:
        spec = build.build_spec(config, Records(records, "train"))
        assert spec.radar.cube_shape == (3, 4, 16, 64)
        assert callable(build.build_loss(config.loss))
    assert f"--config=experiments/configs/{path.stem}.py" in module.__doc__


def test_wrong_keys_answer_before_jax_loads(tmp_path):
    begin = time.monotonic()
    environment = {**os.environ, "JAX_PLATFORMS": "no_such_platform"}
    run = subprocess.run(
        [sys.executable, "-m", "experiments.main", "--workdir", str(tmp_path)],
        cwd=ROOT, env=environment, capture_output=True, text=True,
    )  # fmt: skip
    assert run.returncode == 2 and "config" in run.stderr
    assert time.monotonic() - begin < 20
