"""`jradar points`: options reach the library, limits hold, files belong together."""

import dataclasses

import numpy as np
import pytest

from jradar.cli import main
from jradar.radar import (
    PointSpec,
    point_deviations,
    radar_points,
    static_background,
    subtract_background,
)
from jradar.recordings import (
    open_recording,
    read_cloud,
    valid_points,
    without_background,
)
from tests.cli.conftest import write_cube
from tests.recordings.conftest import root as root, sequence as sequence


@pytest.fixture(scope="module")
def quiet_cube(tmp_path_factory):
    """A frame of zeros."""
    folder = tmp_path_factory.mktemp("quiet")
    path = write_cube(folder, "awr1642")
    np.save(path, np.zeros_like(np.load(path)))
    return path


def test_options_of_the_detector_are_the_librarys(small_cube, run_json, tmp_path):
    options = [
        "--guard",
        "1,3",
        "--train",
        "5,6",
        "--angles",
        "music",
        "--capacity",
        99,
    ]
    run_json("points", small_cube, "-o", tmp_path, *options)
    recording = open_recording(small_cube)
    spec = PointSpec(guard=(1, 3), train=(5, 6), angles="music", capacity=99)
    expected = radar_points(
        recording.cube(0),
        recording.radar,
        points=spec.fitted(recording.radar.spec),
    )
    with np.load(tmp_path / "radar.npz") as file:
        for name, column in valid_points(expected).items():
            np.testing.assert_array_equal(file[name], column)


def test_further_options_and_deviations_are_the_librarys(
    small_cube, run_json, tmp_path
):
    options = ["--group-peaks", "--folds", 1, "--focus", "--deviations"]
    run_json("points", small_cube, "-o", tmp_path, *options)
    recording = open_recording(small_cube)
    spec = PointSpec(group_peaks=True, folds=1, focus=True).fitted(recording.radar.spec)
    cube = recording.cube(0)
    expected = radar_points(cube, recording.radar, points=spec)
    found = point_deviations(expected, recording.radar.spec, points=spec)
    with np.load(tmp_path / "radar.npz") as file:
        for name, column in valid_points(expected).items():
            np.testing.assert_array_equal(file[name], column)
        assert len(file["fold"]) == len(file["fold_margin_db"]) > 0
        for name, values in found._asdict().items():
            column = np.asarray(values)[np.asarray(expected.valid)]
            np.testing.assert_array_equal(file[f"deviation_{name}"], column)


def test_a_window_that_is_too_large_is_shrunk_and_noted(small_cube, run_json, tmp_path):
    result = run_json("points", small_cube, "-o", tmp_path, "--train", "20,4")
    assert "shrunk to guard (0, 2), train (15, 4)" in result["notes"][-1]


def test_points_outside_of_the_limits_are_left_out(small_cube, run_json, tmp_path):
    command = ["points", small_cube, "-o", tmp_path, "--format", "pcd"]
    limits = {"min-range": 1, "max-range": 4.5, "max-azimuth": 30, "max-elevation": 9}
    every = run_json(*command)["points"]
    words = [word for k, v in limits.items() for word in (f"--{k}", v)]
    result = run_json(*command, *words)
    columns = read_cloud(tmp_path / "radar.pcd")
    assert {"velocity", "power", "snr"} <= columns.keys()
    x, y, z = (columns[axis] for axis in "xyz")
    distance = np.sqrt(x**2 + y**2 + z**2)
    assert 0 < len(x) == result["points"] < every
    assert 1 <= distance.min() and distance.max() <= 4.5
    assert np.degrees(np.abs(np.arctan2(y, x))).max() <= 30
    assert np.degrees(np.abs(np.arcsin(z / distance))).max() <= 9.001


def test_dropped_detections_are_counted(small_cube, run_json, tmp_path):
    result = run_json("points", small_cube, "-o", tmp_path, "--capacity", 3)
    assert result["points"] == 3 and result["dropped"] == result["detected"] - 3 > 0
    assert result["saturated"] == 0
    assert any("detections were dropped" in note for note in result["notes"])


def test_limits_that_leave_no_range(small_cube, capsys, tmp_path):
    command = ["points", small_cube, "-o", str(tmp_path), "--min-range", "5"]
    assert main([*command, "--max-range", "5"]) == 2
    assert "--min-range 5 --max-range 5, expected the" in capsys.readouterr().err


def test_several_frames_are_as_each_alone(sequence, run_json, tmp_path):
    command = ["points", sequence, "--format", "csv", "-o"]
    result = run_json(*command, tmp_path / "few", "--frames", "1:3")
    assert [row["frame"] for row in result["detected"]] == [1, 2]
    assert sorted(p.name for p in (tmp_path / "few").iterdir()) == ["000001", "000002"]
    run_json(*command, tmp_path / "one", "--frame", 2)
    for name in ("radar.csv", "radar.npz"):
        alone = (tmp_path / "one" / name).read_bytes()
        assert (tmp_path / "few" / "000002" / name).read_bytes() == alone


def test_nothing_of_an_earlier_run_is_left_and_nothing_else_is_touched(
    small_cube, run_json, tmp_path
):
    stale = ["enhanced.ply", "enhanced.npz", "enhanced.csv", "radar.pcd"]
    own = ["enhanced.txt", "cloud.ply", "radar.ply.bak"]
    for name in (*stale, *own):
        (tmp_path / name).write_text("earlier")
    (tmp_path / ".enhanced.ply-0123abcd").mkdir()  # of a killed process
    (tmp_path / ".enhanced.ply-0123abcd" / ".lock").touch()
    run_json("points", small_cube, "-o", tmp_path)
    written = ["capture.png", "radar.npz", "radar.ply"]
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(own + written)


def test_a_frame_without_echoes_says_so(quiet_cube, run_json, tmp_path):
    result = run_json("points", quiet_cube, "-o", tmp_path)
    assert result["points"] == 0 and result["echoes"] == []
    assert any("no echoes in frame 0" in note for note in result["notes"])
    assert any("all samples are zero" in note for note in result["notes"])
    assert [len(c) for c in read_cloud(tmp_path / "radar.ply").values()] == [0] * 6
    info = run_json("info", quiet_cube)
    assert any("no echoes" in note for note in info["notes"])


def test_too_many_points_are_a_usage_error(small_cube, capsys, tmp_path):
    command = ["points", small_cube, "-o", str(tmp_path / "out"), "--capacity"]
    assert main([*command, "999999999"]) == 2
    assert "capacity = 999,999,999, expected 1 to" in capsys.readouterr().err


def test_background_and_interference_are_removed_as_by_the_library(
    sequence, run_json, tmp_path
):
    options = ["--background", "0:3", "--remove-interference"]
    result = run_json("points", sequence, "-o", tmp_path, "--frame", 3, *options)
    assert any("frames 0 to 2 is subtracted" in note for note in result["notes"])
    recording = open_recording(sequence)
    background = static_background(recording.cubes[:3])
    left = recording._replace(
        cubes=[subtract_background(recording.cubes[3], background)]
    )
    spec = PointSpec(remove_interference=True)
    expected = radar_points(
        left.cubes[0],
        recording.radar,
        points=spec.fitted(recording.radar.spec),
    )
    with np.load(tmp_path / "radar.npz") as file:
        for name, column in valid_points(expected).items():
            np.testing.assert_allclose(file[name], column, rtol=1e-3, atol=1e-3)


def test_the_leakage_is_part_of_the_background(sequence):
    recording = open_recording(sequence)
    measured = dataclasses.replace(recording.radar, leakage=np.ones((2, 2, 4)))
    recording = recording._replace(radar=measured)
    left = without_background(recording, slice(None))
    assert left.radar.leakage is None and len(left.cubes) == len(recording.cubes)
    np.testing.assert_array_equal(left.cubes.stamps, recording.cubes.stamps)


def test_a_background_of_missing_frames(small_cube, capsys, tmp_path):
    command = ["points", small_cube, "-o", str(tmp_path), "--background", "5:9"]
    assert main(command) == 2
    assert "no background in frames 5 and later" in capsys.readouterr().err
