"""Experiments: a killed run ends like an uninterrupted one; flags; every config."""

import importlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import pytest

from experiments import build
from experiments.configs import default
from experiments.tasks import radarhd, rpdnet
from jradar.data import Records

ROOT = Path(__file__).parents[2]
CONFIGS = sorted((ROOT / "experiments" / "configs").glob("[!_]*.py"))
SMALL = [
    "--config.network.channels=8",
    "--config.evaluation.detectors=('os',)",
    "--config.train.batch_size=4",
    "--config.train.steps=24",
    "--config.train.checkpoint_every=8",
    "--config.sampling.steps=3",
]


def start(workdir, *flags, config="smoke", cache=None):
    """Run an experiment in a process of its own; `cache` keeps what it compiles."""
    environment = {**os.environ}
    if cache:
        environment |= {"XDG_CACHE_HOME": str(cache), "JRADAR_CACHE": ""}
        del environment["JAX_COMPILATION_CACHE_DIR"]
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
        ("--config.train.learning_rate=0.1", "train.learning_rate was 0.001, now 0.1"),
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
        (["--config.image.azimuth_deg=(-60.0, 30.0)"], 2, "no view to mirror"),
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
    assert f"--config=experiments/configs/{path.stem}.py" in module.__doc__
    if config.task == "radarhd":
        network, _ = radarhd.build_network(config)
        assert network.outputs == 1
        return
    if config.task == "rpdnet":
        maps = jnp.zeros((2, 128, 128, 1))
        network = rpdnet.build_detector(config)
        logits, _ = jax.eval_shape(network.init_with_output, jax.random.key(0), maps)
        assert logits.shape == maps.shape
        return
    if config.task == "pretrain":
        main = default.get_config()
        for name in ("network", "noise"):  # a prior is of no use with others
            assert config[name].to_dict() == main[name].to_dict()
        assert build.build_network(config).outputs == 4
        return
    spec = build.build_spec(config, Records(records, "train"))
    assert spec.radar.cube_shape == (3, 4, 16, 64)
    assert callable(build.build_loss(config.loss, method=config.method))
    image = jnp.zeros((1, *spec.fine.shape, 2))
    condition = jnp.zeros((1, *spec.coarse.shape, 3 * spec.num_slices))
    found, params = jax.eval_shape(
        spec.network.init_with_output, jax.random.key(0), image, jnp.ones(1), condition
    )
    assert found.shape == (*image.shape[:-1], spec.network.outputs)
    names = str(jax.tree.structure(params))
    assert ("tower" in names) != spec.network.condition_at_input


def test_ablations_differ_from_their_base_in_a_few_fields():
    def fields(name):
        config = importlib.import_module(f"experiments.configs.{name}").get_config()
        return build._flatten(json.loads(config.to_json()))

    for path in CONFIGS:
        if not path.stem.startswith("ablation_"):
            continue
        base = "default" if "import default" in path.read_text() else "paper_loss"
        mine, theirs = fields(path.stem), fields(base)
        changed = {k for k in mine | theirs if mine.get(k) != theirs.get(k)}
        assert 1 <= len(changed) <= 2, (path.stem, changed)


def test_wrong_keys_answer_before_jax_loads(tmp_path):
    begin = time.monotonic()
    environment = {**os.environ, "JAX_PLATFORMS": "no_such_platform"}
    run = subprocess.run(
        [sys.executable, "-m", "experiments.main", "--workdir", str(tmp_path)],
        cwd=ROOT, env=environment, capture_output=True, text=True,
    )  # fmt: skip
    assert run.returncode == 2 and "config" in run.stderr
    assert time.monotonic() - begin < 20
