"""`jradar enhance` and `jradar export`: the library's clouds, timed and written."""

import collections
import dataclasses
import threading

import jax
import numpy as np
import pytest

from jradar import model as models
from jradar.cli import main
from jradar.model import condition, draw, load_model, save_model
from jradar.radar import radar_points
from jradar.range_image import condition_features, fit_trust
from jradar.recordings import (
    Recording,
    open_recording,
    read_cloud,
    without_background,
)
from jradar.session import Stopwatch
from tests.cli.conftest import MODEL, NETWORK, write_cube
from tests.models import tiny_model
from tests.recordings.conftest import root as root, sequence as sequence

WAVEFORM = {
    "start_frequency_hz": 77e9,
    "slope_hz_per_s": 100e12,
    "sample_rate_hz": 20e6,
    "idle_time_s": 7e-6,
    "adc_start_time_s": 2e-6,
    "ramp_end_time_s": 15e-6,
}
QUICK = ("--draws", "2", "--steps", "1")  # the same program in every test


def test_the_result_is_the_librarys(small_cube, model_folder, run_json, tmp_path):
    command = ["enhance", small_cube, "--model", model_folder, "-o", tmp_path]
    result = run_json(*command, "--seed", 3, *QUICK)
    assert result["model"]["purpose"] == "nothing" and not result["notes"]
    assert result["model"]["training steps"] == 7
    recording = open_recording(small_cube)
    image = draw(
        jax.random.key(3),
        condition(recording.cube(0), recording.radar, MODEL),
        load_model(model_folder),
        draws=2,
        steps=1,
    ).range_m
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
    assert len(stages) == 8 and all(value > 0 for value in stages.values())
    assert result["frames/s"] > 0 and result["compiling (s)"] > 0
    assert not (tmp_path / "few" / "000010" / "capture.png").exists()
    alone = run_json(*command, tmp_path / "one", "--frame", 11)
    assert (tmp_path / "one" / "capture.png").exists()
    assert alone["enhanced points"] == result["enhanced"][1]["enhanced points"]
    for name in ("radar.ply", "enhanced.ply"):
        same = (tmp_path / "few" / "000011" / name).read_bytes()
        assert (tmp_path / "one" / name).read_bytes() == same


def test_a_frame_is_processed_while_another_is_in_the_network(
    sequence, model_folder, run_json, tmp_path, monkeypatch
):
    begun, waited = threading.Event(), []
    seen = collections.Counter()
    call = Stopwatch.__call__

    def spy(watch, stage, *rest):
        seen[stage] += 1
        if stage == "condition" and seen[stage] == 2:
            begun.set()
        if stage == "sampling" and seen[stage] == 1:
            waited.append(begun.wait(60))
        return call(watch, stage, *rest)

    monkeypatch.setattr(Stopwatch, "__call__", spy)
    command = ["enhance", sequence, "--model", model_folder, *QUICK]
    run_json(*command, "-o", tmp_path, "--frames", "10:")
    assert waited == [True]


def test_a_frame_that_cannot_be_read_ends_the_recording(
    sequence, model_folder, tmp_path, monkeypatch, capsys
):
    read = Recording.cube

    def failing(recording, frame):
        if frame == 3:
            raise ValueError("frame 3 is damaged")
        return read(recording, frame)

    monkeypatch.setattr(Recording, "cube", failing)
    command = ["enhance", sequence, "--model", model_folder, *QUICK, "--frames", ":"]
    assert main([*map(str, command), "-o", str(tmp_path)]) == 4
    assert "frame 3 is damaged" in capsys.readouterr().err
    assert not (tmp_path / "000003").exists()


def test_another_radar_than_in_training_is_noted(
    flat_cube, model_folder, capsys, tmp_path
):
    command = ["enhance", flat_cube, "--model", model_folder, "-o", str(tmp_path)]
    assert main([*command, *QUICK]) == 2
    err = capsys.readouterr().err
    assert "heights in the result are invented" in err and "--anyway" in err
    assert not [*tmp_path.iterdir()]
    assert main([*command, *QUICK, "--anyway"]) == 0
    out = capsys.readouterr().out
    assert "training steps" in out and "one row of antennas" in out
    assert "other radars (awr1843), expect worse clouds: " in out
    assert "8 virtual antennas here, 12 in training" in out and "range to" not in out


def test_a_frame_unlike_training_is_not_to_be_trusted(small_cube, run_json, tmp_path):
    recording = open_recording(small_cube)
    seen = condition(recording.cube(0), recording.radar, MODEL)
    usual = np.asarray(condition_features(seen))
    noise = np.random.default_rng(0).normal(scale=0.05, size=(60, len(usual)))
    found = []
    for name, mean in (("like", usual), ("unlike", usual + 1.0)):
        trusting = dataclasses.replace(MODEL, trust=fit_trust(mean + noise))
        save_model(tmp_path / name, trusting)
        command = ["enhance", small_cube, "--model", tmp_path / name, *QUICK]
        found.append(run_json(*command, "-o", tmp_path / "out"))
    like, unlike = found
    assert like["unlike training (%)"] < 99 and not like["notes"]
    assert unlike["unlike training (%)"] == 100
    assert any("frame 0 of 1 is unlike 99 % of" in note for note in unlike["notes"])


def test_a_radar_with_real_samples_and_a_silent_frame(model_folder, run_json, tmp_path):
    path = write_cube(tmp_path, "awr2944", **WAVEFORM)
    command = ["enhance", path, "--model", model_folder, "-o", tmp_path / "out", *QUICK]
    assert run_json(*command)["enhanced points"] > 0
    np.save(path, np.zeros_like(np.load(path)))
    result = run_json(*command)
    assert result["radar points"] == result["enhanced points"] == 0
    assert result["detections"] == 0
    assert any("no echoes in frame 0" in note for note in result["notes"])


def test_detections_are_counted_by_cfar_not_by_capacity(
    small_cube, model_folder, run_json, tmp_path
):
    command = ["enhance", small_cube, "--model", model_folder, *QUICK]
    found = run_json(*command, "-o", tmp_path / "a")
    points = run_json(
        "points", small_cube, "-o", tmp_path / "b", "--false-alarm-rate", 1e-3
    )
    assert (
        found["detections"] > 0 and found["radar points"] <= MODEL.spec.points.capacity
    )
    assert found["detections"] == pytest.approx(points["points"], rel=0.3)


def test_limits_apply_to_all_that_is_written(
    small_cube, model_folder, run_json, tmp_path
):
    command = ["enhance", small_cube, "--model", model_folder, *QUICK, "-o", tmp_path]
    every = run_json(*command)
    with np.load(tmp_path / "enhanced.npz") as file:
        image = file["range_image"]
    result = run_json(*command, "--max-azimuth", 30, "--format", "csv")
    for name in ("radar points", "enhanced points"):
        assert 0 < result[name] < every[name]
    with np.load(tmp_path / "enhanced.npz") as file:
        ahead, (x, y, _) = file["range_image"], file["xyz"].T
    assert np.degrees(np.abs(np.arctan2(y, x))).max() <= 30
    middle = slice(image.shape[1] // 4, -image.shape[1] // 4)  # of 120 degrees
    np.testing.assert_array_equal(ahead[:, middle], image[:, middle])
    assert (ahead > 0).sum() == (image[:, middle] > 0).sum() == len(x)
    assert len((tmp_path / "enhanced.csv").read_text().splitlines()) == len(x) + 1
    assert not (tmp_path / "enhanced.ply").exists()


def test_a_shipped_model_is_used_unless_another_is_named(
    small_cube, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(models.folder, "SHIPPED", tmp_path)
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


def test_background_and_interference_reach_the_radar_points(
    small_cube, model_folder, run_json, tmp_path
):
    command = ["enhance", small_cube, "--model", model_folder, "-o", tmp_path]
    options = ["--remove-interference", "--background", ":"]
    result = run_json(*command, *QUICK, *options)
    assert "subtracted as background" in result["notes"][0]
    recording = without_background(open_recording(small_cube), slice(None))
    points = dataclasses.replace(MODEL.spec.points, remove_interference=True)
    expected = radar_points(
        recording.cubes[0], recording.radar, points=points.fitted(recording.radar.spec)
    )
    xyz = np.asarray(expected.xyz)[np.asarray(expected.valid)]
    columns = read_cloud(tmp_path / "radar.ply")
    found = np.stack([columns[axis] for axis in "xyz"], -1)
    np.testing.assert_allclose(found, xyz, atol=1e-3)
