"""Wrong paths, full disks, closed pipes, signals: a code, one line, nothing left."""

import errno
import sys
from pathlib import Path

import numpy as np
import pytest

from jradar import cli
from jradar.cli import paths
from jradar.outputs.clouds import write_ply
from jradar.types import PointCloud
from tests.cli.conftest import write_cube
from tests.programs import finished, started


def test_wrong_paths_answer_without_numpy():
    codes = {
        "info /no.npy": 2,
        "points /no.npy -o x": 2,
        "enhance /no.npy -o x": 2,
        "enhance pyproject.toml --model /no -o x": 5,
        "export /no -o x": 5,
        "points pyproject.toml --radar /no.toml -o x": 2,
        "prepare . --spec /no.toml -o x": 2,
        "prepare /no -o x": 2,
        "export jradar-sim --coupling /no.txt -o x": 2,
        "view /no": 2,
        "points pyproject.toml -o pyproject.toml": 2,
        "points pyproject.toml -o pyproject.toml/x": 2,
        "enhance pyproject.toml -o /proc/foo": 3,
        "calibrate pyproject.toml -o /proc/foo.toml": 3,
    }
    code = (
        "import sys; from jradar.cli import main\n"
        f"print([main(words.split()) for words in {[*codes]}])\n"
        "print('numpy' in sys.modules, 'jax' in sys.modules)"
    )
    run = finished(code)
    assert run.stdout == f"{[*codes.values()]}\nFalse False\n"
    lines = run.stderr.splitlines()
    assert len(lines) == len(codes)
    assert all("no such" in line and "/no" in line for line in lines[:-4])
    assert "is a file, expected the name of a folder" in lines[-4]
    assert "pyproject.toml is a file, expected a folder" in lines[-3]
    assert all("because /proc takes no files" in line for line in lines[-2:])


def test_a_folder_that_is_no_run_has_no_report(tmp_path, refused):
    assert str(tmp_path) in refused("view", tmp_path, "--no-open")


def test_a_full_disk_is_named_with_the_file(small_cube, tmp_path, monkeypatch, refused):
    def full(self, data):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    out = tmp_path / "out"
    err = refused("points", small_cube, "-o", out, code=3)
    assert f"{out / 'radar.ply'}: disk full" in err
    assert not [*out.iterdir()]


@pytest.mark.parametrize(
    ("module", "name", "error", "message"),
    [
        (paths, "open_file", PermissionError(errno.EACCES, "Permission denied", "F"),
         "F: Permission denied"),
        (cli, "check_platform", OSError("JAX finds no such device"), "no such device"),
        (cli, "check_paths", MemoryError("Unable to allocate 7.00 TiB"), "7.00 TiB"),
    ],
)  # fmt: skip
def test_a_fault_of_the_machine_is_code_3(
    small_cube, monkeypatch, refused, module, name, error, message
):
    def fail(*_):
        raise error

    monkeypatch.setattr(module, name, fail)
    assert message in refused("info", small_cube, code=3)


def test_a_missing_extra_is_named(tmp_path, monkeypatch, refused):
    (tmp_path / "a.bag").write_bytes(b"#ROSBAG V2.0\n")
    for name in [name for name in sys.modules if name.startswith("rosbags")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    assert "jradar[ros]" in refused("info", tmp_path / "a.bag", code=3)


def test_a_closed_pipe_ends_quietly(tmp_path):
    write_ply(tmp_path / "a.ply", PointCloud.from_xyz(np.ones((2, 3))))
    process = started("jradar", "info", tmp_path / "a.ply")
    process.stdout.close()
    assert process.stderr.read() == "" and process.wait() == 0


def test_relative_paths_with_spaces_and_any_letters(tmp_path, monkeypatch, run_json):
    folder = tmp_path / "Größe der 雷达 1"
    folder.mkdir()
    write_cube(folder, "awr1843")
    monkeypatch.chdir(tmp_path)
    result = run_json("points", f"{folder.name}/cube.npy", "-o", "aus gabe/é")
    assert [Path(name).is_file() for name in result["written"]] == [True] * 3
