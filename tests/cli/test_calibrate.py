"""`jradar calibrate`: a file that `--radar` reads, better spectra, honest words."""

import re

import numpy as np
import pytest

from jradar.radar import calibrate
from jradar.recordings import open_recording
from jradar.simulation import simulate_sequence
from jradar.simulation.capture_writer import simulate_capture
from jradar.simulation.rig import base_from
from tests.recordings.dca1000_writer import as_bytes


def test_the_written_file_calibrates_the_recording(uncalibrated, run_json, tmp_path):
    file, again = tmp_path / "calibrated.toml", tmp_path / "again.toml"
    found = run_json("calibrate", uncalibrated, "-o", file)
    assert found["written"] == [str(file)] and found["improves"]
    assert found["frames_used"] == 6 and found["range_bias_m"] == 0.05
    rows = {row["residual"]: row for row in found["residuals_echoes_left_out"]}
    assert all(row["before"] != row["after"] for row in rows.values())
    phase, *_ = rows.values()
    assert phase["after"] < 2 < 5 < phase["before"]
    hidden = " ".join(found["not_observable"])
    assert "rotation of all azimuths" in hidden and "transmitter 2" in hidden
    plain, better = open_recording(uncalibrated), open_recording(uncalibrated, file)
    factors = better.radar.channels
    assert factors is not None and len(found["channels"]) == 12
    ratio = calibrate(better.cube(0), better.radar) / plain.cube(0)
    np.testing.assert_allclose(ratio[:, :, 0, 0], factors, rtol=1e-3)
    assert better.radar.spec == plain.radar.spec and better.radar.range_bias_m == 0.05

    # A calibrated recording is calibrated again on top.
    run_json("calibrate", uncalibrated, "-o", again, "--radar", file)
    after = open_recording(uncalibrated, again).radar.channels
    np.testing.assert_allclose(after, factors, atol=0.03)


def test_a_capture_of_lost_samples_is_described_as_it_was_configured(
    uncalibrated, run_json, tmp_path
):
    cubes = np.load(uncalibrated)
    stored = cubes.reshape(*cubes.shape[:-1], -1, 4)[..., :2]
    capture = tmp_path / "adc_data.bin"
    capture.write_bytes(as_bytes(np.rint(stored).reshape(*cubes.shape[:-1], -1)))
    text = uncalibrated.with_name("radar.toml").read_text()
    axes = re.search("axes = .*", text)[0]
    (tmp_path / "radar.toml").write_text(text.replace(axes, "lanes = 4"))
    file = tmp_path / "calibrated.toml"
    found = run_json("calibrate", capture, "-o", file)
    assert found["notes"][0].startswith("four LVDS lanes were enabled")
    plain = open_recording(capture, tmp_path / "radar.toml")
    better = open_recording(capture, file)
    assert better.radar.spec == plain.radar.spec and better.lanes == 4
    assert better.radar.channels is not None
    np.testing.assert_array_equal(better.cube(5), plain.cube(5))


@pytest.mark.slow  # test_level has walks that are not simulated ray by ray
def test_a_level_walk_shows_the_tilt(run_json, tmp_path):
    """The rig's own AWR1843 has a tilt of 9 degrees, by its third transmitter."""
    pytest.importorskip("embreex", reason="the extra `sim` is not installed")
    walk = simulate_sequence("hall", 3, tmp_path, frames=20)
    command = ["calibrate", walk, "--level", "-o", tmp_path / "level.toml"]
    found = run_json(*command)
    assert found["frames_that_show_the_tilt"] > 8
    uncertainty = found["uncertainty_of_the_tilt_deg"]  # of two seconds
    assert abs(found["tilt_deg"] - 9) < 2 * uncertainty < 8
    assert "a tilt" not in " ".join(found["not_observable"])
    again = [*command[:-1], tmp_path / "again.toml", "--radar", command[-1]]
    assert abs(run_json(*again)["tilt_deg"]) < 3


def test_what_cannot_be_calibrated_is_named(uncalibrated, tmp_path, refused):
    out = tmp_path / "out.toml"
    for wrong, code, message in (
        (["-o", tmp_path / "out.cfg"], 2, "expected a name that ends with .toml"),
        (["-o", out, "--frames", "7:9"], 2, "has frames 0 to 5"),
        (["-o", out, "--picture", tmp_path / "x.png"], 2, "expected --mount"),
        (["-o", out, "--level", "--reflector", "3"], 2, "leave one out"),
        (["-o", out, "--reflector", "14.5"], 4, "reflector at 14.5 m is seen in 0"),
    ):
        assert message in refused("calibrate", uncalibrated, *wrong, code=code)


@pytest.mark.slow  # test_mount has walks that are not simulated ray by ray
def test_a_walk_shows_the_mount_and_its_capture_reads_it(run_json, tmp_path):
    pytest.importorskip("rosbags", reason="the extra `ros` is not installed")
    pytest.importorskip("embreex", reason="the extra `sim` is not installed")
    walk = simulate_capture("hallways", 35, tmp_path, frames=200)
    file = walk / "calibrated.toml"
    picture = walk / "mount.png"
    words = ["--level", "--mount", "-o", file, "--picture", picture]
    found = run_json("calibrate", walk, *words)
    assert found["written"] == [str(file), str(picture)]
    assert picture.read_bytes().startswith(b"\x89PNG")
    shown = {row["axis"]: row for row in found["mount"]}
    true = base_from("single_chip")
    for k, axis in enumerate("xyz"):
        row = shown[f"position along the base's {axis} (m)"]
        assert abs(row["value"] - true[k, 3]) < 0.05 and row["shown_by_the_walk"]
    description = walk / "capture.toml"
    text = description.read_text()
    assert open_recording(walk).base_from_radar[0, 3] != pytest.approx(true[0, 3])
    description.write_text(text.replace("awr1843.cfg", "calibrated.toml"))
    after = open_recording(walk)
    assert abs(after.base_from_radar[:3, 3] - true[:3, 3]).max() < 0.05
    assert any("[mount]" in note for note in after.notes)
