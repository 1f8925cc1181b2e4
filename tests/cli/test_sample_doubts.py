"""Doubts about samples reach the notes of `info`, `points` and `enhance`."""

import shutil

import numpy as np
import pytest

from jradar.cli import main


@pytest.fixture
def swapped_cube(small_cube, tmp_path):
    """The simulated frame as int16 in the wrong byte order."""
    cube = np.load(small_cube)
    pairs = np.rint(np.stack([cube.real, cube.imag], -1)).astype(np.int16)
    np.save(tmp_path / "cube.npy", pairs.byteswap())
    shutil.copy(small_cube.replace("cube.npy", "radar.toml"), tmp_path)
    return tmp_path / "cube.npy"


def test_info_prints_how_much_is_at_full_scale(small_cube, swapped_cube, run_json):
    good = run_json("info", small_cube)
    assert good["share at full scale"] == 0 and good["notes"] == []
    assert 0 < good["largest sample"] < 2**15
    [note] = run_json("info", swapped_cube)["notes"]
    assert note.startswith("frame 0: the samples look like numbers in the other byte")


def test_a_silent_frame_has_no_echoes_and_says_so(small_cube, tmp_path, run_json):
    np.save(tmp_path / "cube.npy", 0 * np.load(small_cube))
    shutil.copy(small_cube.replace("cube.npy", "radar.toml"), tmp_path)
    found = run_json("info", tmp_path / "cube.npy")
    assert found["echoes"] == [] and found["moving echoes"] == []
    assert "frame 0: all samples are zero" in found["notes"][0]


def test_points_and_enhance_print_the_doubt(
    swapped_cube, model_folder, tmp_path, capsys
):
    out = str(tmp_path / "out")
    assert main(["points", str(swapped_cube), "-o", out]) == 0
    assert "in the other byte order" in capsys.readouterr().out
    assert main(["enhance", str(swapped_cube), "--model", model_folder, "-o", out]) == 0
    assert "in the other byte order" in capsys.readouterr().out
