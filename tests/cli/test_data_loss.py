"""Commands replace only what jradar wrote: data of somebody else stay as they are."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from jradar.cli import main
from tests.recordings.small_sequence import write_sequence

WORK = "years of work"


def own_data(folder):
    """Write somebody's data into a folder; return all that lies beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "thesis.txt").write_text(WORK)
    return contents(folder)


def contents(folder):
    return {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def refused(command, capsys, code=2):
    assert main([*map(str, command)]) == code
    out, err = capsys.readouterr()
    assert not out and "Traceback" not in err and err.count("\n") == 1, err
    return err


def test_export_onto_a_folder(tmp_path, model_folder, capsys):
    before = own_data(tmp_path / "out")
    command = ["export", model_folder, "-o", tmp_path / "out", "--draws", 1]
    assert "out is a folder, expected the name of a file" in refused(command, capsys)
    assert contents(tmp_path / "out") == before
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize(
    ("kind", "name"),
    [("coloradar", "lab_0"), ("coloradar", "calib"), ("capture", "lab_0")],
)
def test_simulate_beside_own_data(tmp_path, capsys, name, kind):
    pytest.importorskip("embreex")
    before = own_data(tmp_path / "X" / name)
    command = ["simulate", "--scene", "lab", "--frames", 1, "--format", kind]
    err = refused([*command, "-o", tmp_path / "X"], capsys)
    assert f"{name} holds thesis.txt but no simulated.txt" in err
    assert contents(tmp_path / "X" / name) == before


def test_simulate_a_set_beside_own_data(tmp_path, capsys):
    before = own_data(tmp_path)
    command = ["simulate", "--set", "jradar-sim-1-mini", "-o", tmp_path]
    assert "holds thesis.txt but no manifest of a set" in refused(command, capsys)
    assert contents(tmp_path) == before


def test_prepare_into_a_folder_of_own_data(tmp_path, capsys):
    write_sequence(tmp_path / "src", frames=1)
    before = own_data(tmp_path / "dst")
    command = ["prepare", tmp_path / "src", "-o", tmp_path / "dst", "--workers", 1]
    assert "neither empty nor a folder of records" in refused(command, capsys)
    kept = {p: text for p, text in contents(tmp_path / "dst").items() if text}
    assert {p for p in kept if p.name != ".lock"} == before.keys()


def test_a_failed_prepare_with_wrong_types_leaves_the_folder_free(tmp_path, capsys):
    write_sequence(tmp_path / "src", frames=1)
    spec = tmp_path / "spec.toml"
    command = ["prepare", tmp_path / "src", "-o", tmp_path / "dst", "--workers", 1]
    for text in (
        "[points]\ncapacity = '64'",
        "block = [2]",
        "[lidar]\nazimuth = 1",
        "[points]\ntrain = 1",
    ):
        spec.write_text(text)
        err = refused([*command, "--spec", spec], capsys)
        assert "spec.toml: " in err and "expected" in err
        assert not (tmp_path / "dst").exists()
    assert main([*map(str, command)]) == 0


@pytest.mark.parametrize("number, workers", [(signal.SIGINT, 2), (signal.SIGTERM, 1)])
def test_a_signal_ends_prepare_with_one_line_and_nothing_half_written(
    tmp_path, number, workers
):
    write_sequence(tmp_path / "src", frames=60)
    spec = tmp_path / "spec.toml"
    spec.write_text("block = 1\n[points]\ncapacity = 64\n[lidar]\nmax_range_m = 7.0\n")
    program = [sys.executable, "-m", "jradar.cli", "prepare", str(tmp_path / "src")]
    process = subprocess.Popen(
        [*program, "-o", str(tmp_path / "dst"), "--spec", str(spec)]
        + ["--workers", str(workers)],
        stderr=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[2],
        start_new_session=True,
        # A test in the background of a shell would hand down that SIGINT is ignored.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    while not [*tmp_path.rglob("000*.json")]:
        assert process.poll() is None
        time.sleep(0.01)
    os.killpg(process.pid, number)  # as a terminal does
    begin = time.monotonic()
    _, err = process.communicate(timeout=60)
    took = time.monotonic() - begin
    shown = [line for line in err.splitlines() if not line.startswith("preparing")]
    assert process.returncode == 128 + number and len(shown) == 1, err
    assert took < 10  # 0.7 s on a machine that does nothing else
    hidden = [p for p in (tmp_path / "dst").rglob(".*") if p.name != ".lock"]
    assert not hidden
