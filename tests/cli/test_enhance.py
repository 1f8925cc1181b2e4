"""`jradar enhance` and `jradar export`: the library's clouds, timed and written."""

import jax
import numpy as np
import pytest

from jradar import model as models
from jradar.cli import main
from jradar.model import condition, draw, load_model, save_model
from jradar.recordings import calibrated_cube, open_recording
from tests.cli.conftest import MODEL, NETWORK
from tests.models import tiny_model
from tests.recordings.conftest import root as root, sequence as sequence

QUICK = ("--draws", "2", "--steps", "1")  # the same program in every test


def test_the_result_is_the_librarys(small_cube, model_folder, run_json, tmp_path):
    command = ["enhance", small_cube, "--model", model_folder, "-o", tmp_path]
    result = run_json(*command, "--seed", 3, *QUICK)
    assert result["model"]["purpose"] == "nothing" and not result["notes"]
    assert result["model"]["training steps"] == 7
    recording = open_recording(small_cube)
    image = draw(
        jax.random.key(3),
        condition(calibrated_cube(recording, 0), MODEL, radar=recording.radar),
        load_model(model_folder),
        draws=2,
        steps=1,
    )
    with np.load(tmp_path / "enhanced.npz") as file:
        np.testing.assert_allclose(file["range_image"], image, atol=1e-4)
        assert len(file["xyz"]) == (image > 0).sum() == result["enhanced points"] > 0
        distance = np.linalg.norm(file["xyz"], axis=1)
        np.testing.assert_allclose(distance, image[image > 0], atol=1e-4)
    assert (tmp_path / "capture.png").stat().st_size > 10_000


def test_every_stage_of_several_frames_is_timed(
    sequence, model_folder, run_json, tmp_path
):
    command = ["enhance", sequence, "--model", model_folder, *QUICK, "-o"]
    result = run_json(*command, tmp_path / "few", "--frames", "10:")
    assert [row["frame"] for row in result["enhanced"]] == [10, 11]
    stages = result["milliseconds per frame"]
    assert len(stages) == 6 and all(value > 0 for value in stages.values())
    drawing = sum(stages.values()) - stages["writing"]
    rate = result["frames/s without writing"]
    assert rate == pytest.approx(1000 / drawing) and result["compiling (s)"] > 0
    alone = run_json(*command, tmp_path / "one", "--frame", 11)
    assert alone["enhanced points"] == result["enhanced"][1]["enhanced points"]
    for name in ("radar.ply", "enhanced.ply"):
        same = (tmp_path / "few" / "000011" / name).read_bytes()
        assert (tmp_path / "one" / name).read_bytes() == same


def test_a_radar_without_elevation_is_noted(flat_cube, model_folder, capsys, tmp_path):
    command = ["enhance", flat_cube, "--model", model_folder, "-o", str(tmp_path)]
    assert main([*command, *QUICK]) == 0
    out = capsys.readouterr().out
    assert "training steps" in out and "one row of antennas" in out


def test_a_shipped_model_is_used_unless_another_is_named(
    small_cube, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(models, "SHIPPED", tmp_path)
    command = ["enhance", small_cube, "-o", str(tmp_path / "out")]
    assert main(command) == 5 and "no model at jradar-sim" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    save_model(tmp_path / "jradar-sim", tiny_model(network=NETWORK, purpose="shipped"))
    assert main(command) == 0 and "shipped" in capsys.readouterr().out


def test_a_missing_model_is_code_5(small_cube, tmp_path, capsys):
    out = tmp_path / "out"
    command = ["enhance", small_cube, "--model", str(tmp_path / "no"), "-o", str(out)]
    assert main(command) == 5 and "no model at" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize("command", ["enhance", "export"])
def test_a_regression_model_takes_no_sampling_options(
    command, small_cube, tmp_path, capsys
):
    pytest.importorskip("flatbuffers", reason="needs jradar[export]")
    folder, out = str(tmp_path / "model"), tmp_path / "out"
    save_model(folder, tiny_model(network=NETWORK, method="regression"))
    words = [small_cube, "--model", folder] if command == "enhance" else [folder]
    assert main([command, *words, "-o", str(out), "--draws", "1"]) == 2
    assert "draws: a model trained by regression" in capsys.readouterr().err
    assert not out.exists()
    assert main([command, *words, "-o", str(out)]) == 0 and out.exists()
