"""Experiments: a killed run ends like an uninterrupted one; flags; every config."""

import functools
import importlib
import json
import signal
import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments import build, enhance, main as command, maps, rpdnet, train
from experiments.configs import smoke
from experiments.radarhd.model import build_spec
from experiments.weights import initial_weights
from jradar.data import Records, pairs_of
from jradar.errors import UsageError
from jradar.evaluation import mean_scores, points_of, write_scores
from jradar.model import draw
from jradar.range_image import image_cloud
from tests import programs
from tests.evaluation import invented
from tests.programs import ROOT, started

SMOKE = f"--config={ROOT}/experiments/configs/smoke.py"
RADARHD = SMOKE.replace("smoke", "radarhd")
NOWHERE = "--config.data.path=nowhere"
CONFIGS = sorted((ROOT / "experiments" / "configs").glob("[!_]*.py"))


def run(workdir, *flags):
    """Run an experiment in this process; returns the exit code."""
    return command.main(["main", *flags, f"--workdir={workdir}"])


def losses(workdir):
    lines = (workdir / "metrics.jsonl").read_text().splitlines()
    return [(line["step"], line["loss"]) for line in map(json.loads, lines)]


def table(workdir):
    """The evaluation's table without its times."""
    text = (workdir / "evaluation" / "table.md").read_text()
    return [line for line in text.splitlines() if "| ms |" not in line]


def test_a_run_leaves_its_results_in_the_workdir(finished, records):
    workdir = finished.workdir
    assert "smoke test" in finished.out and "one-step estimate" in finished.out
    written = {path.name for path in (workdir / "model").iterdir()}
    assert {"model.json", "weights.safetensors"} <= written
    assert (workdir / "evaluation" / "samples.png").stat().st_size > 10_000
    assert (workdir / "samples" / "000012.png").stat().st_size > 5_000
    card = json.loads((workdir / "model_card.json").read_text())
    assert card["steps"] == 12 and card["config"]["train"]["batch_size"] == 4
    assert card["data_digest"] == Records(records, "train").digest


@pytest.mark.slow
def test_validation_scores_what_the_final_table_scores(made, records, tmp_path):
    config, model = made(smoke)
    config.sampling.update(steps=2, draws=3)
    checked = Records(records, "validation")
    found = enhance.validate(config, model, checked, picture=tmp_path / "some.png")
    key, clouds = build.random_key(config, build.SAMPLE_KEY), []
    for i, pair in enumerate(pairs_of(model.spec, checked)):
        image = draw(jax.random.fold_in(key, i), pair.condition, model, draws=3)
        clouds.append(points_of(image_cloud(image, model.spec.frame_grid.view)))
    assert found == mean_scores(clouds, [frame.lidar_xyz for frame in checked])
    assert np.isfinite(found["chamfer"])


@pytest.mark.slow  # test_processes kills a smaller run
@pytest.mark.timeout(900)
def test_killed_run_ends_with_the_losses_of_an_uninterrupted_one(finished, tmp_path):
    killed = tmp_path / "killed"
    process = started("experiments.main", f"--workdir={killed}", *finished.flags)
    steps, deadline = killed / "checkpoints", time.monotonic() + 200
    while not (steps.exists() and any(p.name == "4" for p in steps.iterdir())):
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    assert not (killed / "model").exists()

    assert run(killed, *finished.flags) == 0
    assert losses(killed) == losses(finished.workdir) and len(losses(killed)) == 12
    assert table(killed) == table(finished.workdir)


def test_other_data_at_the_same_path_are_refused(finished, monkeypatch, capsys):
    monkeypatch.setattr(Records, "digest", "of other data")
    call = ["main", *finished.flags, f"--workdir={finished.workdir}"]
    assert command.main(call) == 5
    err = capsys.readouterr().err
    assert "is of another run: data was" in err and "now of other data" in err


def test_seeds_are_run_one_after_another_and_spread(tmp_path, monkeypatch, capsys):
    seen = []

    def fake_run(task, config, workdir):
        seen.append((config.seed, workdir.name, config.data.path))
        factor = 1 + 0.1 * config.seed
        rows = [r | {"chamfer": factor * r["chamfer"]} for r in invented.scores()]
        write_scores(workdir / "evaluation" / "frames.jsonl", rows)
        (workdir / "data" / "records").mkdir(parents=True, exist_ok=True)

    monkeypatch.setattr(train, "run", fake_run)
    assert run(tmp_path, SMOKE, "--seeds=0:3") == 0
    records = str(tmp_path / "seed_0" / "data" / "records")
    assert seen == [(0, "seed_0", ""), (1, "seed_1", records), (2, "seed_2", records)]
    mean = np.mean([r["chamfer"] for r in invented.scores() if r["method"] == "jradar"])
    expected = f"| jradar | {1.1 * mean:.3f} ± {0.1 * mean:.3f} |"
    assert expected in capsys.readouterr().out


def test_an_optimizer_of_no_steps_can_be_built():
    config = smoke.get_config()
    config.train.steps = 0
    optimizer = build.build_optimizer(config.train)
    assert optimizer.init({"w": jnp.zeros(2)})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("--config.train.learning_rate=0.1", "train.learning_rate was 0.001, now 0.1"),
        ("--config.seed=1", "seed was 0, now 1"),
    ],
)
def test_a_workdir_is_for_one_config(finished, change, message, capsys):
    assert run(finished.workdir, *finished.flags, change) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("flags", "code", "message"),
    [
        (["--config.train.step=3"], 2, "'train.step', did you mean train.steps?"),
        (["--config.trian.steps=3"], 2, "'trian.steps', did you mean train.steps?"),
        (["--config.train.steps=many"], 2, "many"),
        (["--mode=fly"], 2, "fly"),
        (["stray"], 2, "unexpected argument 'stray'"),
        (["--config.task=fly"], 2, "task = 'fly', expected one of"),
        (["--config.network.preset=huge"], 2, "huge"),
        (["--config.noise.prediction=huge"], 2, "noise.prediction = 'huge', expected"),
        (["--config.noise.sigma_min=-1.0"], 2, "config.noise: sigma_min = -1.0"),
        (["--config.method=huge"], 2, "method = 'huge', expected one of"),
        (["--config.evaluation.split=final"], 2, "evaluation.split: 'final', expected"),
        (["--seeds=3"], 2, "--seeds=3, expected two or more"),
        (["--seeds=3:4"], 2, "--seeds=3:4, expected two or more"),
        (["--config.sampling.solver=huge"], 2, "sampling.solver = 'huge', expected"),
        ([NOWHERE], 2, "data.path = nowhere: no such"),
        ([RADARHD, NOWHERE], 2, "data.path = nowhere: no such"),
        ([RADARHD, NOWHERE, "--mode=eval"], 5, "no model at"),
        ([RADARHD, "--config.model=no", "--mode=eval"], 5, "no model at no: expected"),
        (["--config.data.set=nothing"], 2, "config.data: set 'nothing', expected one"),
        (["--config.train.initial=nowhere"], 2, "no weights at train.initial"),
        (["--config.image.azimuth_deg=(-60.0, 30.0)"], 2, "cannot be mirrored"),
        (["--mode=eval"], 5, "no model at"),
    ],
)
def test_fault_is_one_line_with_its_code(tmp_path, capsys, flags, code, message):
    config = [] if RADARHD in flags else [SMOKE]
    assert run(tmp_path / "new", *config, *flags) == code
    out, err = capsys.readouterr()
    assert out == "" and message in err
    assert err.count("\n") == 1 and "Traceback" not in err
    known_late = "data.set" in flags[0]  # after the workdir was started
    assert (tmp_path / "new" / "config.json").exists() == known_late


def test_damaged_data_have_their_code(tmp_path, capsys):
    (tmp_path / "records").mkdir()
    (tmp_path / "records" / "manifest.json").write_text("{")
    flags = [SMOKE, f"--config.data.path={tmp_path / 'records'}"]
    assert run(tmp_path / "new", *flags) == 4
    assert "manifest.json is damaged or not a JSON file" in capsys.readouterr().err


def test_a_run_turns_on_the_cache_before_jax_is_needed(tmp_path, monkeypatch):
    called = []
    monkeypatch.setattr(command, "use_compilation_cache", lambda: called.append(1))
    assert run(tmp_path, SMOKE, "--mode=eval") == 5 and called == [1]


def test_missing_config_is_named(tmp_path, capsys):
    assert run(tmp_path, "--config=experiments/configs/nothing.py") == 2
    missing = "no such config file: experiments/configs/nothing.py"
    assert missing in capsys.readouterr().err


def test_wrong_keys_answer_before_jax_loads(tmp_path):
    code = (
        "import sys; from experiments import main; "
        f"code = main.main(['main', {SMOKE!r}, '--workdir={tmp_path / 'new'}', "
        "'--config.train.step=3']); "
        "assert code == 2, code; assert 'jax' not in sys.modules"
    )
    done = programs.finished(code)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("\n") == 1 and "did you mean train.steps?" in done.stderr
    assert not (tmp_path / "new").exists()


@functools.cache
def shapes_of(network, *shapes):
    """The shape of a network's output, and the names of its parameters."""
    image, condition = map(jnp.zeros, shapes)
    inputs = jax.random.key(0), image, jnp.ones(1), condition
    found, params = jax.eval_shape(network.init_with_output, *inputs)
    return found.shape, str(jax.tree.structure(params))


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_config_is_buildable_and_its_record_names_its_command(records, path):
    module = importlib.import_module(f"experiments.configs.{path.stem}")
    config = module.get_config()
    assert f"--config=experiments/configs/{path.stem}.py" in module.__doc__
    assert config.purpose
    if config.task == "radarhd":
        spec = build_spec(config)
        assert spec.noise.prediction.name == "occupancy"
        assert spec.grid.condition_shape[-1] == config.data.history
        shapes = ((1, *spec.grid.image_shape), (1, *spec.grid.condition_shape))
        assert shapes_of(spec.network, *shapes)[0] == shapes[0]
        return
    if config.task == "maps":
        found, _ = shapes_of(maps.network(config), (1, 64, 64, 64), (1, 64, 64, 67))
        assert found == (1, 64, 64, 64)
        return
    if config.task == "rpdnet":
        power = jnp.zeros((2, 128, 128, 1))
        network = rpdnet.build_detector(config)
        logits, _ = jax.eval_shape(network.init_with_output, jax.random.key(0), power)
        assert logits.shape == power.shape
        return
    spec = build.build_spec(config, Records(records, "train"))
    assert spec.points.false_alarm_rate == 1.0
    assert callable(build.build_loss(config.loss, method=config.method))
    image, condition = (1, *spec.grid.image_shape), (1, *spec.grid.condition_shape)
    found, names = shapes_of(spec.network, image, condition)
    anchors = 3 * getattr(spec.network, "anchors", 0)
    assert found == (*image[:-1], spec.network.outputs + anchors)
    assert ("tower" in names) != spec.network.condition_at_input


@pytest.mark.parametrize("name", ["paper", "coloradar"])
def test_the_papers_setting_is_edms_and_starts_from_image_weights(name):
    config = importlib.import_module(f"experiments.configs.{name}").get_config()
    noise = build.build_noise(config)
    assert noise.prediction.name == "edm" and noise.sigma_data == 0.5
    assert (noise.log_mean, noise.log_std) == (-1.2, 1.2)  # Karras et al. 2022
    assert config.sampling.temperature == 1 and config.sampling.draws == 1
    assert build.build_network(config).stem == (1, 4)
    assert min(config.loss[term] for term in ("squared", "absolute", "perceptual")) > 0
    with pytest.raises(UsageError, match="no weights to start from"):
        initial_weights(config.train)
