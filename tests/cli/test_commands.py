"""`jradar info` and `points`: real captures, sequences, and one line for a fault."""

import json

import numpy as np
import pytest

from jradar.cli import main
from tests.recordings.coloradar_writer import write_radar
from tests.recordings.conftest import root as root, sequence as sequence
from tests.recordings.cube_writer import random_cube, save, save_studio

OPENRADAR = """
[radar]
device = "awr1642"
start_frequency_hz = 77.4201e9
slope_hz_per_s = 60e12
sample_rate_hz = 2.5e6
idle_time_s = 30e-6
ramp_end_time_s = 62e-6

[file]
axes = ["chirp", "virtual", "sample"]
"""


@pytest.fixture
def openradar(samples, tmp_path):
    (tmp_path / "radar.toml").write_text(OPENRADAR)
    capture = samples / "openradar" / "doppler_example_1.npy"
    return [str(capture), "--radar", str(tmp_path / "radar.toml")]


def test_info_finds_the_wall_and_two_walkers(openradar, run_json):
    result = run_json("info", *openradar)
    assert result["radar"]["range_resolution_m"] == pytest.approx(0.04879, abs=1e-5)
    assert "unsigned" in result["notes"][0]
    wall = result["echoes"][0]
    assert (wall["range_bin"], wall["doppler_bin"]) == (107, 0)
    assert wall["range_m"] == pytest.approx(5.22, abs=0.01)
    away, near = result["moving echoes"][:2]
    assert away["range_bin"] == 60 and near["range_bin"] in (60, 61)
    assert 0.5 < away["velocity_mps"] < 0.65 and -0.85 < near["velocity_mps"] < -0.45
    assert 5 < away["azimuth_deg"] < 9 and -17 < near["azimuth_deg"] < -11


def test_points_of_a_real_capture_hold_the_walkers(openradar, run_json, tmp_path):
    out = tmp_path / "out"
    result = run_json("points", *openradar, "-o", str(out), "--remove-static")
    names = ["capture.png", "radar.npz", "radar.ply"]
    assert sorted(p.name for p in out.iterdir()) == names
    with np.load(out / "radar.npz") as file:
        distance = np.linalg.norm(file["xyz"], axis=1)
        near = np.abs(distance - 2.95) < 0.06
        assert result["points"] == len(distance) > 50
        assert {-1.0, 1.0} <= {*np.sign(file["velocity"][near])}
        assert not file["xyz"][:, 2].any()  # one row of antennas


def test_a_sequence_is_described_with_all_its_streams(root, sequence, run_json, capsys):
    result = run_json("info", str(sequence), "--frame", "11")
    assert [s["stream"] for s in result["streams"]] == ["radar", "lidar", "poses"]
    assert result["frames with a LiDAR scan"] == result["frames"] == 12
    assert result["readable"]["scan 11"] == "yes, 2 points, 1 of them returns"
    assert result["radar"]["tx x rx x chirps x samples"] == [2, 2, 4, 8]
    assert main(["info", str(root)]) == 2
    assert str(sequence) in capsys.readouterr().err


def test_points_of_a_sequence(sequence, run_json, tmp_path):
    out = str(tmp_path / "out")
    result = run_json("points", str(sequence), "-o", out, "--frame", "1")
    assert result["radar"] == "coloradar single_chip"
    assert (tmp_path / "out" / "capture.png").stat().st_size > 10_000


def test_a_truncated_last_frame_leaves_the_first_readable(sequence, run_json, capsys):
    data = sequence / "single_chip/adc_samples/data"
    (data / "frame_11.bin").write_bytes(b"123")
    result = run_json("info", str(sequence))
    assert "frame_11.bin holds 3 bytes" in result["readable"]["frame 11"]
    assert main(["info", str(sequence), "--frame", "11"]) == 4
    assert main(["info", str(data / "frame_0.bin")]) == 2
    assert "name the folder of its sequence" in capsys.readouterr().err


def test_the_sensor_is_chosen_and_repairs_are_one_line_each(root, sequence, capsys):
    assert main(["info", str(sequence), "--sensor", "cascade"]) == 2
    assert "no cascade/adc_samples/data" in capsys.readouterr().err
    write_radar(sequence, "cascade", count=2)
    waveform = (root / "calib/single_chip/waveform_cfg.txt").read_text()
    (root / "calib/cascade").mkdir()
    (root / "calib/cascade/waveform_cfg.txt").write_text(
        waveform.replace("7.00000009601e-06", "7.00000009601")
    )
    (root / "calib/cascade/antenna_cfg.txt").write_bytes(
        (root / "calib/single_chip/antenna_cfg.txt").read_bytes()
    )
    assert main(["info", str(sequence), "--sensor", "cascade", "--json"]) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out)["radar"]["name"] == "coloradar cascade"
    assert captured.err.startswith("jradar: warning: ")
    assert "adc_start_time = 7 s is impossible" in captured.err
    assert captured.err.count("\n") == 1


def test_one_chirp_per_frame_is_a_range_profile(samples, run_json):
    capture = str(samples / "dca1000" / "adc_data_0.bin")
    for frame in ("0", "617"):
        result = run_json("info", capture, "--frame", frame)
        assert [echo["range_bin"] for echo in result["echoes"][:2]] == [11, 19]
        ranges = [echo["range_m"] for echo in result["echoes"][:2]]
        assert ranges == pytest.approx([2.15, 3.71], abs=0.01)


def test_frames_as_slow_time(samples, run_json):
    capture = str(samples / "dca1000" / "adc_data_0.bin")
    result = run_json("info", capture, "--frames-as-chirps")
    assert [echo["range_bin"] for echo in result["echoes"][:2]] == [11, 19]
    assert result["radar"]["max_velocity_mps"] == pytest.approx(0.966, abs=1e-3)


def truncated(folder):
    path = save_studio(folder, random_cube((3, 2, 4, 4, 8)))
    path.write_bytes(path.read_bytes()[:-7])
    return path


def with_nan(folder):
    cube = random_cube()
    cube[0, 0, 0, 0] = np.nan
    return save(folder, cube)


@pytest.mark.parametrize(
    ("make", "code", "message"),
    [
        (truncated, 4, "needs a multiple of 1,024"),
        (lambda d: save(d, random_cube((2, 4, 4, 9))), 4, "frames of (2, 4, 4, 9)"),
        (with_nan, 4, "samples of frame 0 are NaN or infinite"),
        (lambda d: d / "nothing.npy", 2, "no such file"),
        (lambda d: d, 2, "holds no recording, expected a folder"),
    ],
    ids=["truncated", "wrong_size", "nan", "missing", "folder"],
)
def test_fault_is_one_line_and_leaves_nothing(tmp_path, capsys, make, code, message):
    capture = make(tmp_path)
    assert main(["points", str(capture), "-o", str(tmp_path / "out")]) == code
    captured = capsys.readouterr()
    assert message in captured.err and captured.err.count("\n") == 1
    assert not captured.out and not (tmp_path / "out").exists()


def test_an_unknown_detector_is_a_usage_error(small_cube, capsys, tmp_path):
    out = tmp_path / "out"
    assert main(["points", str(small_cube), "--detector", "x", "-o", str(out)]) == 2
    assert "detector = 'x', expected one of ('ca', 'go'" in capsys.readouterr().err
    assert not out.exists()


def test_a_frame_beyond_the_recording_is_a_usage_error(small_cube, capsys):
    for frame in ("1", "-1"):
        assert main(["info", small_cube, "--frame", frame]) == 2
        assert "has frames 0 to 0" in capsys.readouterr().err
