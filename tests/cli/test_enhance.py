"""`jradar enhance` and `jradar export`: the library's clouds, timed and written."""

import dataclasses

import jax
import numpy as np
import pytest

from jradar.cli import main
from jradar.model import condition, draw, load_model, save_model
from jradar.options import models
from jradar.outputs import frame_folder
from jradar.radar import radar_points
from jradar.recordings import open_recording, read_cloud, without_background
from tests.cli.conftest import MODEL, QUICK, write_cube
from tests.models import tiny_model, tiny_polar_model
from tests.recordings.conftest import root as root, sequence as sequence

WAVEFORM = {"start_frequency_hz": 77e9, "slope_hz_per_s": 100e12, "idle_time_s": 7e-6}
WAVEFORM |= {"sample_rate_hz": 20e6, "adc_start_time_s": 2e-6, "ramp_end_time_s": 15e-6}


@pytest.fixture
def enhance(small_cube, model_folder, run_json, tmp_path):
    """Run the command on a small frame; return its result."""

    def run(*options, path=small_cube, model=model_folder, out=tmp_path / "out"):
        return run_json("enhance", path, "--model", model, *QUICK, "-o", out, *options)

    return run


def test_the_result_is_the_librarys(enhance, small_cube, model_folder, tmp_path):
    result = enhance("--seed", 3)
    assert result["model"]["purpose"] == "nothing" and not result["notes"]
    assert result["model"]["training_steps"] == 7
    recording = open_recording(small_cube)
    seen = condition(recording.cube(0), recording.radar, MODEL)
    drawing = jax.random.key(3), seen, load_model(model_folder)
    image = draw(*drawing, draws=2, steps=1).range_m
    with np.load(tmp_path / "out" / "enhanced.npz") as file:
        np.testing.assert_allclose(file["range_image"], image, atol=1e-4)
        assert len(file["xyz"]) == (image > 0).sum() == result["enhanced_points"] > 0
        share = f"{result['confidence_percent']:.0f}% of its points may be right"
        assert share in file["verdict"]
        distance = np.linalg.norm(file["xyz"], axis=1)
        np.testing.assert_allclose(distance, image[image > 0], atol=1e-4)
    assert (tmp_path / "out" / "capture.png").stat().st_size > 10_000

    # A training's workdir holds its model. Limits apply to all that is written.
    save_model(tmp_path / "run" / "model", MODEL)
    options = ("--seed", 3, "--max-azimuth", 30, "--format", "csv")
    ahead = enhance(*options, model=tmp_path / "run")
    for name in ("radar_points", "enhanced_points"):
        assert 0 < ahead[name] < result[name]
    with np.load(tmp_path / "out" / "enhanced.npz") as file:
        limited, (x, y, _) = file["range_image"], file["xyz"].T
    assert np.degrees(np.abs(np.arctan2(y, x))).max() <= 30
    middle = slice(image.shape[1] // 4, -image.shape[1] // 4)  # of 120 degrees
    np.testing.assert_allclose(limited[:, middle], image[:, middle], atol=1e-4)
    assert (limited > 0).sum() == (image[:, middle] > 0).sum() == len(x)
    rows = (tmp_path / "out" / "enhanced.csv").read_text().splitlines()
    assert len(rows) == len(x) + 1
    assert not (tmp_path / "out" / "enhanced.ply").exists()


@pytest.mark.slow
def test_every_stage_of_several_frames_is_timed(
    enhance, sequence, tmp_path, monkeypatch
):
    with monkeypatch.context() as patched:  # matplotlib loads for pictures alone
        patched.setattr(
            frame_folder, "_viz", lambda: pytest.fail("matplotlib is loaded")
        )
        result = enhance("--frames", "10:", path=sequence, out=tmp_path / "few")
    assert [row["frame"] for row in result["enhanced"]] == [10, 11]
    stages = result["milliseconds_per_frame"]
    assert len(stages) == 8 and all(value > 0 for value in stages.values())
    assert result["frames_per_s"] > 0 and result["compiling_s"] > 0
    assert not (tmp_path / "few" / "000010" / "capture.png").exists()
    alone = enhance("--frame", 11, path=sequence, out=tmp_path / "one")
    assert (tmp_path / "one" / "capture.png").exists()
    assert alone["enhanced_points"] == result["enhanced"][1]["enhanced_points"]
    for name in ("radar.ply", "enhanced.ply"):
        same = (tmp_path / "few" / "000011" / name).read_bytes()
        assert (tmp_path / "one" / name).read_bytes() == same


def test_a_flat_folder_is_read_in_order_by_kiss_icp(enhance, sequence, tmp_path):
    generic = pytest.importorskip("kiss_icp.datasets.generic")
    flat = tmp_path / "flat"
    result = enhance("--frames", "9:11", "--flat", path=sequence, out=flat)
    assert result["written"] == [str(flat)]
    found = sorted(path.relative_to(flat).as_posix() for path in flat.rglob("[!.]*.*"))
    names = ("enhanced/000009", "enhanced/000010", "radar/000009", "radar/000010")
    assert found == [f"{name}.ply" for name in names]
    clouds = generic.GenericDataset(flat / "enhanced")
    assert len(clouds) == 2
    for number, row in enumerate(result["enhanced"]):
        xyz, _ = clouds[number]
        assert len(xyz) == row["enhanced_points"] > 0


@pytest.mark.slow
def test_another_radar_than_in_training_is_noted(
    flat_cube, model_folder, capsys, tmp_path, refused
):
    command = ["enhance", flat_cube, "--model", model_folder, *QUICK]
    err = refused(*command, "-o", tmp_path / "out")
    assert "heights in the result are invented" in err and "--anyway" in err
    assert "`--model radarhd` for a cloud in the plane" in err
    assert not (tmp_path / "out").exists()
    assert main([*command, "--anyway", "-o", str(tmp_path / "out")]) == 0
    out = capsys.readouterr().out
    assert "training steps" in out and "one row of antennas" in out
    assert "other radars (awr1843), so expect worse clouds: " in out
    assert "8 virtual antennas here, 12 in training" in out and "range to" not in out


@pytest.mark.slow
def test_a_radar_with_one_row_gets_a_cloud_in_its_plane(run_json, flat_cube, tmp_path):
    save_model(tmp_path / "mine", tiny_polar_model())
    options = ("--model", tmp_path / "mine", "-o", tmp_path / "out")
    found = run_json("enhance", flat_cube, *options)
    assert "height is not measured: all points lie at height 0" in found["notes"]
    assert found["model"]["trained_on"] == "a test, radar radarhd"
    assert found["enhanced_points"] > 0


def test_a_radar_with_real_samples_and_a_silent_frame(enhance, tmp_path):
    path = write_cube(tmp_path, "awr2944", **WAVEFORM)
    assert enhance("--no-picture", path=path)["enhanced_points"] > 0
    np.save(path, np.zeros_like(np.load(path)))
    result = enhance("--no-picture", path=path)
    assert result["radar_points"] == result["enhanced_points"] == 0
    assert any("no echoes in frame 0" in note for note in result["notes"])


def test_a_shipped_model_is_used(small_cube, tmp_path, monkeypatch, refused, capsys):
    monkeypatch.setattr(models, "WEIGHTS", tmp_path)
    command = ["enhance", small_cube, "-o", str(tmp_path / "out"), "--no-picture"]
    assert "no model at jradar-sim" in refused(*command, code=5)
    missing = refused(*command, "--model", tmp_path / "no", code=5)
    assert "no model at" in missing and not (tmp_path / "out").exists()
    card = dataclasses.replace(MODEL.card, purpose="shipped")
    regression = tiny_model(method="regression", card=card)
    save_model(tmp_path / "jradar-sim", regression)
    assert main(command) == 0 and "shipped" in capsys.readouterr().out


@pytest.mark.parametrize("command", ["enhance", "export"])
def test_regression_takes_no_sampling_options(command, small_cube, tmp_path, refused):
    folder, out = str(tmp_path / "model"), tmp_path / "out"
    save_model(folder, tiny_model(method="regression"))
    words = [small_cube, "--model", folder] if command == "enhance" else [folder]
    found = refused(command, *words, "-o", out, "--draws", 1)
    assert "draws: a model trained by regression" in found
    assert not out.exists()


@pytest.mark.slow
def test_background_and_interference_reach_the_points(enhance, small_cube, tmp_path):
    result = enhance("--remove-interference", "--background", ":", "--no-picture")
    assert "subtracted as background" in result["notes"][0]
    recording = without_background(open_recording(small_cube), slice(None))
    points = dataclasses.replace(MODEL.spec.points, remove_interference=True)
    spec = points.fitted(recording.radar.spec)
    expected = radar_points(recording.cubes[0], recording.radar, points=spec)
    xyz = np.asarray(expected.xyz)[np.asarray(expected.valid)]
    columns = read_cloud(tmp_path / "out" / "radar.ply")
    found = np.stack([columns[axis] for axis in "xyz"], -1)
    np.testing.assert_allclose(found, xyz, atol=1e-3)
