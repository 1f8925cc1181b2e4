"""Faults of a user or a machine end every experiment with one line and its code."""

import os
import signal
import time

import pytest

from experiments import convert_weights, main as command
from experiments.studies import robustness
from tests.experiments.conftest import TINY
from tests.programs import ROOT, started

SMOKE = f"--config={ROOT}/experiments/configs/smoke.py"
WORK = "years of work"


def ends(call, capsys, code):
    """Call, and return the one line that it prints."""
    assert call() == code
    out, err = capsys.readouterr()
    assert not out and "Traceback" not in err and err.count("\n") == 1, err
    return err


@pytest.mark.parametrize(
    ("study", "arguments", "code"),
    [
        (robustness, ["--rates=nowhere", "-o", "out"], 2),
        (convert_weights, ["nowhere.pkl", "out"], 2),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_a_missing_path_is_named(study, arguments, code, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    err = ends(lambda: study.main(arguments), capsys, code)
    assert "nowhere" in err
    assert not [*tmp_path.iterdir()]


def test_an_output_below_a_file_is_refused_at_once(tmp_path, capsys):
    (tmp_path / "file").write_text(WORK)
    call = ["--rates=none", "-o", str(tmp_path / "file" / "out")]
    assert "file is a file" in ends(lambda: robustness.main(call), capsys, 2)
    assert (tmp_path / "file").read_text() == WORK


@pytest.mark.parametrize(
    "run",
    [
        lambda out: robustness.main(["--rates=none", "-o", str(out)]),
        lambda out: command.main(["main", SMOKE, f"--workdir={out}"]),
    ],
    ids=["study", "experiment"],
)
def test_a_missing_gpu_is_an_error_of_the_machine(run, tmp_path, capsys, monkeypatch):
    def devices():
        raise AssertionError  # as JAX does without the plug-in

    monkeypatch.setenv("JAX_PLATFORMS", "cuda")
    monkeypatch.setattr("jax.devices", devices)
    err = ends(lambda: run(tmp_path / "out"), capsys, 3)
    assert "JAX_PLATFORMS=cuda, but JAX finds no such device" in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["metrics.jsonl", "checkpoints", "model_card.json"])
def test_a_workdir_of_something_else_is_left_alone(records, name, tmp_path, capsys):
    (tmp_path / name).write_text(WORK)
    call = ["main", TINY, f"--config.data.path={records}", f"--workdir={tmp_path}"]
    err = ends(lambda: command.main(call), capsys, 2)
    assert f"holds {name} but no config.json" in err
    assert (tmp_path / name).read_text() == WORK
    assert {path.name for path in tmp_path.iterdir()} == {name, ".lock"}


def test_a_second_run_in_a_workdir_is_refused_with_the_firsts_number(tmp_path, capsys):
    from jradar.files import lock_folder

    with lock_folder(tmp_path):
        call = ["main", SMOKE, f"--workdir={tmp_path}"]
        err = ends(lambda: command.main(call), capsys, 3)
    assert f"another process ({os.getpid()}) is running in" in err


@pytest.mark.parametrize("content", ["{", "[1]", "\udcff"])
def test_a_damaged_config_of_a_workdir_is_named(records, tmp_path, capsys, content):
    path = tmp_path / "config.json"
    path.write_bytes(content.encode("utf-8", "surrogateescape"))
    call = ["main", TINY, f"--config.data.path={records}", f"--workdir={tmp_path}"]
    assert str(path) in ends(lambda: command.main(call), capsys, 4)


@pytest.mark.slow
def test_sigterm_outside_of_training_ends_with_143_and_nothing_half_written(tmp_path):
    pytest.importorskip("embreex")
    process = started("experiments.main", SMOKE, f"--workdir={tmp_path / 'run'}")
    recordings = tmp_path / "run" / "data" / "recordings"
    while not [*recordings.glob(".hallways*")]:  # a sequence is being written
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(signal.SIGTERM)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 128 + signal.SIGTERM, err
    assert err.splitlines()[-1] == "error: ended by SIGTERM" and "Traceback" not in err
    assert not [p for p in recordings.iterdir() if p.name.startswith(".")]
