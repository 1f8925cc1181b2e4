"""`jradar simulate`: plans, dry runs, and options that exclude each other."""

from pathlib import Path

import pytest

from jradar.cli import main, simulating


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
        monkeypatch.setattr(simulating, name, write)
    return found


@pytest.mark.parametrize(
    ("options", "megabytes"), [([], 55), (["--format", "capture"], 35)]
)
def test_a_dry_run_writes_nothing_to_the_output(
    tmp_path, run_json, roots, options, megabytes
):
    command = ["simulate", "--scene", "lab", "--frames", 30, "-o", tmp_path, *options]
    plan = run_json(*command, "--dry-run")
    assert plan["size"] == f"{megabytes} MB" and plan["frames per recording"] == 30
    assert plan["written"].startswith("nothing")
    assert len(roots) == 1 and roots[0] != tmp_path
    done = run_json(*command)
    assert done["written"] == str(tmp_path / "lab_0") and roots[1] == tmp_path


def test_a_disk_without_space_is_refused_before_the_first_frame(
    tmp_path, capsys, roots
):
    out = tmp_path / "new" / "out"
    command = ["simulate", "--scene", "lab", "--frames", "999999999", "-o", str(out)]
    assert main(command) == 3
    assert "1,835,007,998 MB, but its disk has" in capsys.readouterr().err
    assert not roots and not out.parent.exists()


def test_a_set_that_does_not_exist_is_code_2_and_names_those_that_do(tmp_path, capsys):
    command = ["simulate", "--set", "jradar-sim", "-o", str(tmp_path / "out")]
    assert main(command) == 2
    error = capsys.readouterr().err
    assert "jradar-sim-1-mini" in error and "standing-still" in error


@pytest.mark.parametrize(
    "options",
    [
        ["--scene", "lab", "--sensor", "both"],
        ["--set", "jradar-sim-1-mini"],
    ],
)
def test_captures_are_of_one_scene_and_the_single_chip(options, tmp_path, capsys):
    command = ["simulate", "-o", str(tmp_path / "out"), "--format", "capture"]
    assert main([*command, *options]) == 2
    assert "--format capture" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
