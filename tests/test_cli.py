"""The command line: real captures, JSON, files, one line and a code per fault."""

import json
import subprocess
import sys

import numpy as np
import pytest

from jradar import bundle as bundles
from jradar.bundle import save_bundle
from jradar.cli import main
from tests.recordings.coloradar_writer import write_radar
from tests.recordings.conftest import root as root, sequence as sequence
from tests.recordings.test_cubes import random_cube, save, save_studio
from tests.test_bundle import bundle  # noqa: F401  (a fixture)

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


@pytest.fixture
def three_tx(tmp_path):
    """A simulated frame of a device with elevation, as files."""
    import jax

    from jradar.radar import RadarSpec, simulate_cube
    from tests.recordings.small_sequence import room_echoes

    radar = RadarSpec.awr1843(num_chirps=32, num_samples=64)
    echoes = room_echoes(np.random.default_rng(0))
    cube = simulate_cube(jax.random.key(0), echoes, radar, noise_power=100.0)
    np.save(tmp_path / "cube.npy", np.asarray(cube))
    (tmp_path / "radar.toml").write_text(
        '[radar]\ndevice = "awr1843"\nnum_chirps = 32\nnum_samples = 64\n'
    )
    return str(tmp_path / "cube.npy")


def run_json(capsys, *arguments):
    assert main([*arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_info_finds_the_wall_and_two_walkers(openradar, capsys):
    result = run_json(capsys, "info", *openradar)
    assert result["radar"]["range_resolution_m"] == pytest.approx(0.04879, abs=1e-5)
    assert "unsigned" in result["notes"][0]
    wall = result["echoes"][0]
    assert (wall["range_bin"], wall["doppler_bin"]) == (107, 0)
    assert wall["range_m"] == pytest.approx(5.22, abs=0.01)
    away, near = result["moving echoes"][:2]
    assert away["range_bin"] == 60 and near["range_bin"] in (60, 61)
    assert 0.5 < away["velocity_mps"] < 0.65 and -0.85 < near["velocity_mps"] < -0.45
    assert 5 < away["azimuth_deg"] < 9 and -17 < near["azimuth_deg"] < -11


def test_points_of_a_real_capture_hold_the_walkers(openradar, capsys, tmp_path):
    out = tmp_path / "out"
    result = run_json(capsys, "points", *openradar, "-o", str(out), "--remove-static")
    names = ["capture.png", "radar.npz", "radar.ply"]
    assert sorted(p.name for p in out.iterdir()) == names
    with np.load(out / "radar.npz") as file:
        distance = np.linalg.norm(file["xyz"], axis=1)
        near = np.abs(distance - 2.95) < 0.06
        assert result["points"] == len(distance) > 50
        assert {-1.0, 1.0} <= {*np.sign(file["velocity"][near])}
        assert not file["xyz"][:, 2].any()  # one row of antennas


def test_a_sequence_is_described_with_all_its_streams(root, sequence, capsys):
    result = run_json(capsys, "info", str(sequence), "--frame", "11")
    assert [s["stream"] for s in result["streams"]] == ["radar", "lidar", "poses"]
    assert result["frames with a LiDAR scan"] == result["frames"] == 12
    assert result["readable"]["scan 11"] == "yes, 2 points, 1 of them returns"
    assert result["radar"]["tx x rx x chirps x samples"] == [2, 2, 4, 8]
    assert main(["info", str(root)]) == 4
    assert str(sequence) in capsys.readouterr().err


def test_points_of_a_sequence(sequence, capsys, tmp_path):
    out = str(tmp_path / "out")
    result = run_json(capsys, "points", str(sequence), "-o", out, "--frame", "1")
    assert result["radar"] == "coloradar single_chip"
    assert (tmp_path / "out" / "capture.png").stat().st_size > 10_000


def test_a_truncated_last_frame_is_said_and_the_first_still_read(sequence, capsys):
    data = sequence / "single_chip/adc_samples/data"
    (data / "frame_11.bin").write_bytes(b"123")
    result = run_json(capsys, "info", str(sequence))
    assert "frame_11.bin holds 3 bytes" in result["readable"]["frame 11"]
    assert main(["info", str(sequence), "--frame", "11"]) == 4
    assert main(["info", str(data / "frame_0.bin")]) == 4
    assert "name the folder of its sequence" in capsys.readouterr().err


def test_the_sensor_is_chosen_and_repairs_are_one_line_each(root, sequence, capsys):
    assert main(["info", str(sequence), "--sensor", "cascade"]) == 4
    assert "has no cascade/adc_samples/data" in capsys.readouterr().err
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
    assert "adc_start_time = 7 s cannot be" in captured.err
    assert captured.err.count("\n") == 1


def test_one_chirp_per_frame_is_a_range_profile(samples, capsys):
    capture = str(samples / "dca1000" / "adc_data_0.bin")
    for frame in ("0", "617"):
        result = run_json(capsys, "info", capture, "--frame", frame)
        assert [echo["range_bin"] for echo in result["echoes"][:2]] == [11, 19]
        ranges = [echo["range_m"] for echo in result["echoes"][:2]]
        assert ranges == pytest.approx([2.15, 3.71], abs=0.01)


def test_frames_as_slow_time(samples, capsys):
    capture = str(samples / "dca1000" / "adc_data_0.bin")
    result = run_json(capsys, "info", capture, "--frames-as-chirps")
    assert [echo["range_bin"] for echo in result["echoes"][:2]] == [11, 19]
    assert result["radar"]["max_velocity_mps"] == pytest.approx(0.966, abs=1e-3)


def test_enhance_says_what_the_weights_and_the_radar_are_worth(
    openradar,
    bundle,  # noqa: F811
    capsys,
    tmp_path,
):
    save_bundle(tmp_path / "bundle", bundle)
    weights = ["--weights", str(tmp_path / "bundle"), "-o", str(tmp_path / "out")]
    result = run_json(capsys, "enhance", *openradar, *weights, "--steps", "3")
    assert result["weights"]["purpose"] == "nothing"
    assert result["weights"]["training steps"] == 7
    assert any("one row of antennas" in note for note in result["notes"])


@pytest.mark.parametrize("sampling", [["--steps", "3"], ["--draws", "4"]])
def test_enhance_writes_a_finite_cloud(
    sampling,
    three_tx,
    bundle,  # noqa: F811
    capsys,
    tmp_path,
):
    save_bundle(tmp_path / "bundle", bundle)
    weights = ["--weights", str(tmp_path / "bundle"), "-o", str(tmp_path / "out")]
    assert main(["enhance", three_tx, *weights, *sampling]) == 0
    out = capsys.readouterr().out
    assert "training steps" in out and "one row" not in out
    with np.load(tmp_path / "out" / "enhanced.npz") as file:
        assert np.isfinite(file["xyz"]).all() and file["range_image"].shape == (8, 32)
        assert len(file["xyz"]) == (file["range_image"] > 0).sum()
    assert (tmp_path / "out" / "capture.png").stat().st_size > 10_000


def test_enhance_times_every_stage_of_several_frames(
    sequence,
    bundle,  # noqa: F811
    capsys,
    tmp_path,
    monkeypatch,
):
    monkeypatch.setattr(bundles, "WEIGHTS", tmp_path)
    save_bundle(tmp_path / "jradar-sim", bundle)
    few = ["--frames", "10:", "--steps", "1", "-o", str(tmp_path / "few")]
    result = run_json(capsys, "enhance", str(sequence), *few)
    assert [row["frame"] for row in result["enhanced"]] == [10, 11]
    stages = result["milliseconds of a frame"]
    assert len(stages) == 6 and all(value > 0 for value in stages.values())
    drawing = sum(stages.values()) - stages["writing"]
    rate = result["frames a second, without writing"]
    assert rate == pytest.approx(1000 / drawing) and result["compiling (s)"] > 0.1
    one = ["--frame", "11", "--steps", "1", "-o", str(tmp_path / "one")]
    alone = run_json(capsys, "enhance", str(sequence), "--weights", "jradar-sim", *one)
    assert alone["enhanced points"] == result["enhanced"][1]["enhanced points"]
    for name in ("radar.ply", "enhanced.ply"):
        same = (tmp_path / "few" / "000011" / name).read_bytes()
        assert (tmp_path / "one" / name).read_bytes() == same


def test_without_shipped_weights_enhance_says_so(
    three_tx, capsys, tmp_path, monkeypatch
):
    monkeypatch.setattr(bundles, "WEIGHTS", tmp_path / "none")
    assert main(["enhance", three_tx, "-o", str(tmp_path / "out")]) == 5
    assert "ships no weights 'jradar-sim'" in capsys.readouterr().err


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
        (with_nan, 4, "not finite numbers"),
        (lambda d: d / "nothing.npy", 2, "no such file"),
        (lambda d: d, 4, "holds no recording: expected a .npy"),
    ],
    ids=["truncated", "wrong_size", "nan", "missing", "folder"],
)
def test_fault_is_one_line_and_leaves_nothing(tmp_path, capsys, make, code, message):
    capture = make(tmp_path)
    assert main(["points", str(capture), "-o", str(tmp_path / "out")]) == code
    captured = capsys.readouterr()
    assert message in captured.err and captured.err.count("\n") == 1
    assert not captured.out and not (tmp_path / "out").exists()


def test_missing_weights_are_code_5(three_tx, tmp_path, capsys):
    out = str(tmp_path / "out")
    code = main(["enhance", three_tx, "--weights", str(tmp_path / "no"), "-o", out])
    assert code == 5 and "no weights at" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_frame_that_is_not_there(three_tx, capsys):
    assert main(["info", three_tx, "--frame", "3"]) == 4
    assert "has frames 0 to 0" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["info"],
        ["points", "x.npy"],
        ["points", "x.npy", "-o", "out", "--false-alarm-rate", "2"],
        ["points", "x.npy", "-o", "out", "--capacity", "0"],
        ["inform", "x.npy"],
    ],
)
def test_usage_errors_are_code_2(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2


def test_help_names_files_and_answers_without_jax():
    code = "import sys; from jradar.cli import main; main(['points', '--help'])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.returncode == 0 and "adc_data.bin" in run.stdout
