"""`jradar points`: options reach the library, limits hold, frames are as each alone."""

import numpy as np

from jradar import radar
from jradar.outputs.clouds import valid_points
from jradar.recordings import open_recording, read_cloud
from tests.cli.conftest import write_cube
from tests.recordings.conftest import root as root, sequence as sequence


def assert_columns(path, expected):
    """The NPZ file has the columns of a cloud."""
    with np.load(path) as file:
        for name, column in expected.items():
            np.testing.assert_allclose(file[name], column, rtol=1e-4, atol=1e-4)
    return expected


def test_options_of_the_detector_are_the_librarys(small_cube, run_json, tmp_path):
    options = "--guard 1,3 --train 5,6 --angles music --capacity 99 --group-peaks "
    options += "--folds 1 --deviations --detector ca"
    run_json("points", small_cube, "-o", tmp_path, *options.split())
    recording = open_recording(small_cube)
    given = {"guard": (1, 3), "train": (5, 6), "angles": "music", "capacity": 99}
    spec = radar.PointSpec(**given, group_peaks=True, folds=1, detector="ca")
    spec = spec.fitted(recording.radar.spec)
    expected = radar.radar_points(recording.cube(0), recording.radar, points=spec)
    columns = assert_columns(tmp_path / "radar.npz", valid_points(expected))
    assert len(columns["fold"]) == len(columns["fold_margin_db"]) > 0
    found = radar.point_deviations(expected, recording.radar.spec, points=spec)
    valid = np.asarray(expected.valid)
    columns = {f"deviation_{k}": np.asarray(v) for k, v in found._asdict().items()}
    deviations = {name: values[valid] for name, values in columns.items()}
    assert_columns(tmp_path / "radar.npz", deviations)


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


def test_several_frames_are_as_each_alone(sequence, run_json, tmp_path):
    command = ["points", sequence, "--format", "csv", "-o"]
    result = run_json(*command, tmp_path / "few", "--frames", "1:3")
    assert result["radar"] == "coloradar single_chip"
    assert [row["frame"] for row in result["detected"]] == [1, 2]
    names = sorted(p.name for p in (tmp_path / "few").glob("[!.]*"))
    assert names == ["000001", "000002"]
    run_json(*command, tmp_path / "one", "--frame", 2)
    assert (tmp_path / "one" / "capture.png").stat().st_size > 10_000
    for name in ("radar.csv", "radar.npz"):
        alone = (tmp_path / "one" / name).read_bytes()
        assert (tmp_path / "few" / "000002" / name).read_bytes() == alone


def test_a_frame_without_echoes_says_so(run_json, tmp_path):
    path = write_cube(tmp_path, "awr1843", silent=True)
    result = run_json("points", path, "-o", tmp_path / "out")
    assert result["points"] == 0 and result["echoes"] == []
    assert "frame 0: all samples are zero" in result["notes"][0]
    assert any("no echoes in frame 0" in note for note in result["notes"])
    columns = read_cloud(tmp_path / "out" / "radar.ply")
    assert [len(column) for column in columns.values()] == [0] * 6
    found = run_json("info", path)
    assert found["echoes"] == found["moving_echoes"] == []
    assert "frame 0: all samples are zero" in found["notes"][0]
    assert any("no echoes" in note for note in found["notes"])


def test_background_and_interference_go_as_by_the_library(sequence, run_json, tmp_path):
    options = ["--background", "0:3", "--remove-interference"]
    result = run_json("points", sequence, "-o", tmp_path, "--frame", 3, *options)
    assert any("frames 0 to 2 is subtracted" in note for note in result["notes"])
    recording = open_recording(sequence)
    background = radar.static_background(recording.cubes[:3])
    left = radar.subtract_background(recording.cubes[3], background)
    spec = radar.PointSpec(remove_interference=True).fitted(recording.radar.spec)
    expected = radar.radar_points(left, recording.radar, points=spec)
    with np.load(tmp_path / "radar.npz") as file:
        for name, column in valid_points(expected).items():
            np.testing.assert_allclose(file[name], column, rtol=1e-3, atol=1e-3)
