"""`jradar prepare` and `jradar simulate`: what is written, planned and refused."""

import os
import shutil
import signal
import time
from pathlib import Path

import pytest

from jradar.data import Records
from jradar.simulation import plan
from tests.programs import started
from tests.recordings.small_sequence import write_sequence, write_stamps


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    root = tmp_path_factory.mktemp("sequences")
    write_sequence(root, "run0", frames=3)
    write_sequence(root, "run1", frames=2, lidar_delay=0.02, seed=1)
    return root


@pytest.fixture(scope="module")
def spec(tmp_path_factory):
    path = tmp_path_factory.mktemp("spec") / "spec.toml"
    text = "block = 1\n[points]\ncapacity = 64\n[lidar]\nmax_range_m = 7.0\n"
    path.write_text(text)
    return path


def test_what_was_written_and_dropped_is_printed(root, spec, tmp_path, run_json):
    command = ("prepare", root, "--spec", spec, "--workers", 1, "-o", tmp_path / "dst")
    result = run_json(*command)
    assert result["frames"] == 5 and len(result["sequences"]) == 2
    assert result["dropped"] == []
    records = Records(tmp_path / "dst")
    assert len(records) == 5 and records[0].radar.xyz.shape == (64, 3)
    assert records.manifest["options"]["lidar"]["max_range_m"] == 7.0

    command = ("prepare", root, "-o", tmp_path / "look", "--spec", spec, "--preview")
    result = run_json(*command, "--frames", "1:2")
    assert result["frame"] == 1 and result["kept"] <= result["in_the_radars_view"]
    (picture,) = (tmp_path / "look").glob("[!.]*")
    assert result["written"] == [str(picture)] and picture.name == "preparation.png"


def test_frames_without_a_scan_are_printed_and_a_wrong_field_leaves_nothing(
    root, spec, tmp_path, refused, run_json
):
    shutil.copytree(root / "calib", tmp_path / "src" / "calib")
    shutil.copytree(root / "run0", tmp_path / "src" / "run0")
    write_stamps(tmp_path / "src" / "run0" / "lidar", (1000.0, 1000.1, 5000.0))
    command = ("prepare", tmp_path / "src", "-o", tmp_path / "dst", "--spec")
    wrong = tmp_path / "wrong.toml"
    wrong.write_text("[lidar]\nmax_range = 7.0")
    found = refused(*command, wrong)
    assert "wrong.toml: " in found and "'max_range', expected max_range_m" in found
    assert not (tmp_path / "dst").exists()
    (dropped,) = run_json(*command, spec, "--workers", 1)["dropped"]
    assert dropped["sequence"] == "run0" and dropped["frames"] == 1
    assert dropped["reason"] == "no LiDAR scan within 50 ms"


@pytest.mark.parametrize(
    ("number", "workers"),
    [(signal.SIGTERM, 1), pytest.param(signal.SIGINT, 2, marks=pytest.mark.slow)],
)
def test_a_signal_ends_prepare_with_one_line_and_nothing_half_written(
    spec, tmp_path, number, workers
):
    write_sequence(tmp_path / "src", frames=60)
    words = ("prepare", tmp_path / "src", "-o", tmp_path / "dst", "--spec", spec)
    process = started(
        "jradar",
        *(*words, "--workers", workers),
        start_new_session=True,
        # A test in the background of a shell would hand down that SIGINT is ignored.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    while not [*(tmp_path / "dst" / "run0").glob("0*.json")]:
        assert process.poll() is None
        time.sleep(0.01)
    os.killpg(process.pid, number)  # as a terminal does
    begin = time.monotonic()
    _, err = process.communicate(timeout=60)
    took = time.monotonic() - begin
    shown = [line for line in err.splitlines() if not line.startswith("preparing")]
    assert process.returncode == 128 + number and len(shown) == 1, err
    assert number == signal.SIGINT or shown == ["jradar: ended by SIGTERM"]
    assert took < 10  # 0.7 s on a machine that does nothing else
    hidden = [p for p in (tmp_path / "dst").rglob(".*") if p.name != ".lock"]
    assert not hidden


@pytest.fixture
def roots(monkeypatch):
    """Folders to which sequences were written, by a stand-in that writes none."""
    found = []

    def write(family, seed, root, *, frames, advance, sensor="single_chip"):
        found.append(Path(root))
        for _ in range(frames):
            advance()
        return Path(root) / f"{family}_{seed}"

    for name in ("simulate_sequence", "simulate_capture"):
        monkeypatch.setattr(plan, name, write)
    return found


@pytest.mark.parametrize(
    ("options", "megabytes"), [([], 55), (["--format", "capture"], 35)]
)
def test_a_dry_run_writes_nothing(tmp_path, run_json, roots, options, megabytes):
    command = ["simulate", "--scene", "lab", "--frames", 30, "-o", tmp_path, *options]
    planned = run_json(*command, "--dry-run")
    assert planned["size"] == f"{megabytes} MB"
    assert planned["frames_per_recording"] == 30
    assert planned["written"].startswith("nothing")
    assert len(roots) == 1 and roots[0] != tmp_path
    done = run_json(*command)
    assert done["written"] == str(tmp_path / "lab_0") and roots[1] == tmp_path


@pytest.mark.parametrize(
    ("options", "code", "messages"),
    [
        ("--scene lab --frames 999999999", 3, ("1,835,007,998 MB, but its disk has",)),
        ("--set jradar-sim", 2, ("jradar-sim-1-mini", "standing-still")),
        ("--scene lab --sensor both --format capture", 2, ("--format capture needs",)),
        ("--set jradar-sim-1-mini --format capture", 2, ("--format capture needs",)),
    ],
)
def test_what_cannot_be_simulated_is_refused_before_the_first_frame(
    options, code, messages, tmp_path, refused, roots
):
    out = tmp_path / "new" / "out"
    found = refused("simulate", "-o", out, *options.split(), code=code)
    assert all(message in found for message in messages)
    assert not roots and not out.parent.exists()
