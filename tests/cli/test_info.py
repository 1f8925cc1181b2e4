"""`jradar info`: real captures, sequences, and one line for a fault."""

import json

import numpy as np
import pytest

from jradar.cli import main
from tests.recordings.coloradar_writer import write_radar
from tests.recordings.conftest import root as root, sequence as sequence
from tests.recordings.cube_writer import LOG, random_cube, save, save_studio

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


@pytest.mark.slow
def test_a_wall_and_two_walkers_are_found(openradar, run_json, tmp_path):
    result = run_json("info", *openradar)
    assert result["radar"]["range_resolution_m"] == pytest.approx(0.04879, abs=1e-5)
    assert "unsigned" in result["notes"][0]
    wall = result["echoes"][0]
    assert (wall["range_bin"], wall["doppler_bin"]) == (107, 0)
    assert wall["range_m"] == pytest.approx(5.22, abs=0.01)
    away, near = result["moving_echoes"][:2]
    assert away["range_bin"] == 60 and near["range_bin"] in (60, 61)
    assert 0.5 < away["velocity_mps"] < 0.65 and -0.85 < near["velocity_mps"] < -0.45
    assert 5 < away["azimuth_deg"] < 9 and -17 < near["azimuth_deg"] < -11

    out = tmp_path / "out"
    result = run_json("points", *openradar, "-o", str(out), "--remove-static")
    with np.load(out / "radar.npz") as file:
        distance = np.linalg.norm(file["xyz"], axis=1)
        near = np.abs(distance - 2.95) < 0.06
        assert result["points"] == len(distance) > 50
        assert {-1.0, 1.0} <= {*np.sign(file["velocity"][near])}
        assert not file["xyz"][:, 2].any()  # one row of antennas


@pytest.mark.slow
def test_frames_of_one_chirp_are_range_profiles_or_slow_time(samples, run_json):
    capture = str(samples / "dca1000" / "adc_data_0.bin")
    for options in (["--frame", "617"], ["--frames-as-chirps"]):
        result = run_json("info", capture, *options)
        assert [echo["range_bin"] for echo in result["echoes"][:2]] == [11, 19]
        ranges = [echo["range_m"] for echo in result["echoes"][:2]]
        assert ranges == pytest.approx([2.15, 3.71], abs=0.01)
    assert result["radar"]["max_velocity_mps"] == pytest.approx(0.966, abs=1e-3)


def test_a_sequence_is_described_with_its_streams(root, sequence, run_json, refused):
    result = run_json("info", sequence, "--frame", "11")
    assert [s["stream"] for s in result["streams"]] == ["radar", "lidar", "poses"]
    assert result["frames_with_a_lidar_scan"] == result["frames"] == 12
    assert result["readable"]["scan_11"] == "yes, 2 points, 1 of them returns"
    assert result["radar"]["tx_x_rx_x_chirps_x_samples"] == [2, 2, 4, 8]
    (row,) = run_json("info", root, "--workers", "1")["by_recording"]
    assert (row["name"], row["frames"]) == (sequence.name, 12)
    assert "has frames 0 to 11" in refused("info", sequence, "--frame", "12")

    data = sequence / "single_chip/adc_samples/data"
    (data / "frame_11.bin").write_bytes(b"123")
    result = run_json("info", sequence)
    assert "frame_11.bin holds 3 bytes" in result["readable"]["frame_11"]
    refused("info", sequence, "--frame", "11", code=4)
    found = refused("info", data / "frame_0.bin")
    assert "name the folder of its sequence" in found


def test_a_simulated_walk_is_described(walk, run_json):
    info = run_json("info", walk)
    assert info["frames_with_a_lidar_scan"] == info["frames_with_a_pose"] == 4
    assert 12 < info["radar"]["max_range_m"] < 16
    assert info["share_at_full_scale"] == 0 < info["largest_sample"] < 2**15
    assert [s["stream"] for s in info["streams"]] == ["radar", "lidar", "poses", "imu"]


def test_the_sensor_is_chosen_and_repairs_are_lines(root, sequence, capsys, refused):
    command = ["info", str(sequence), "--sensor", "cascade"]
    assert "no cascade/adc_samples/data" in refused(*command)
    write_radar(sequence, "cascade", count=2)
    waveform = (root / "calib/single_chip/waveform_cfg.txt").read_text()
    (root / "calib/cascade").mkdir()
    changed = waveform.replace("7.00000009601e-06", "7.00000009601")
    (root / "calib/cascade/waveform_cfg.txt").write_text(changed)
    (root / "calib/cascade/antenna_cfg.txt").write_bytes(
        (root / "calib/single_chip/antenna_cfg.txt").read_bytes()
    )
    assert main([*command, "--json"]) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out)["radar"]["name"] == "coloradar cascade"
    assert captured.err.startswith("jradar: warning: ")
    assert "adc_start_time = 7 s is impossible" in captured.err
    assert captured.err.count("\n") == 1


def test_a_configuration_of_a_log_is_named(tmp_path, run_json):
    second = LOG.replace("FrameConfig,0,1,3,4", "FrameConfig,0,1,3,8")
    path = save_studio(tmp_path, random_cube((3, 2, 4, 4, 8)), log=LOG + second)
    result = run_json("info", path, "--radar", f"{tmp_path}/adc_LogFile.txt#1")
    assert result["frames"] == 3
    assert any("#1 was taken" in note for note in result["notes"])


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
        (truncated, 4, "--allow-partial reads the whole frames"),
        (lambda d: save(d, random_cube((2, 4, 4, 9))), 4, "frames of (2, 4, 4, 9)"),
        (lambda d: save(d, np.array([{}], object)), 4, "damaged or not a .npy file"),
        (with_nan, 4, "samples of frame 0 are NaN or infinite"),
        (lambda d: d / "nothing.npy", 2, "no such file"),
        (lambda d: d, 2, "holds no recording, expected a folder"),
    ],
)
def test_a_fault_is_one_line_and_leaves_nothing(tmp_path, refused, make, code, message):
    capture, out = make(tmp_path), tmp_path / "out"
    found = refused("points", capture, "-o", out, code=code)
    assert message in found and "pickle" not in found
    assert not out.exists()


def test_a_configuration_is_read_as_one(samples, run_json, refused):
    path = samples / "cfg" / "mmwave_ti_ros__1843_3d.cfg"
    result = run_json("info", path)
    assert result["the_board_can_run_it"] == "yes" and result["models"]
    assert "awr9999" in refused("info", path, "--device", "awr9999")
