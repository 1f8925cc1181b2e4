"""`jradar calibrate`: a file that `--radar` reads, better spectra, honest words."""

import dataclasses

import jax
import numpy as np
import pytest

from jradar.cli import main
from jradar.radar import calibrate, simulate_cube
from jradar.recordings import (
    open_recording,
    write_radar_toml,
)
from jradar.simulation import simulate_sequence
from tests.calibration.test_self_calibration import CHIP, channels, scatterers
from tests.recordings.conftest import root as root, sequence as sequence

FRAMES = 6


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A few frames of an uncalibrated radar, as cube.npy, and its channels."""
    folder = tmp_path_factory.mktemp("uncalibrated")
    true = channels(CHIP, 25)
    response = true.reshape(3, 4, 1, 1).astype(np.complex64)
    cubes = [
        simulate_cube(jax.random.key(frame), scatterers(frame), CHIP) * response
        for frame in range(FRAMES)
    ]
    noise = np.random.default_rng(0).standard_normal((2, FRAMES, *CHIP.cube_shape))
    np.save(folder / "cube.npy", np.stack(cubes) + 5 * (noise[0] + 1j * noise[1]))
    (folder / "radar.toml").write_text(
        '[radar]\ndevice = "awr1843"\nnum_chirps = 16\nnum_samples = 128\n'
        '[file]\naxes = ["frame", "tx", "rx", "chirp", "sample"]\n'
        "[calibration]\nrange_bias_m = 0.05\n"
    )
    return folder / "cube.npy", true


def test_the_written_file_calibrates_the_recording(recording, run_json, tmp_path):
    path, true = recording
    file = tmp_path / "calibrated.toml"
    found = run_json("calibrate", path, "-o", file)
    assert found["written"] == [str(file)] and found["improves"]
    assert found["frames used"] == FRAMES and found["range bias (m)"] == 0.05
    rows = {row["residual"]: row for row in found["residuals, echoes left out"]}
    assert all(row["before"] != row["after"] for row in rows.values())
    phase, *_ = rows.values()
    assert phase["after"] < 2 < 5 < phase["before"]
    hidden = " ".join(found["not observable"])
    assert "turn of all azimuths" in hidden and "transmitter 2" in hidden
    factors = open_recording(path, file).radar.channels
    assert factors is not None and len(found["channels"]) == 12
    plain, better = open_recording(path), open_recording(path, file)
    ratio = calibrate(better.cube(0), better.radar) / plain.cube(0)
    np.testing.assert_allclose(ratio[:, :, 0, 0], factors, rtol=1e-3)
    assert better.radar.spec == plain.radar.spec and better.radar.range_bias_m == 0.05


def test_a_calibrated_recording_is_calibrated_again_on_top(
    recording, run_json, tmp_path
):
    path, _ = recording
    first, again = tmp_path / "first.toml", tmp_path / "again.toml"
    run_json("calibrate", path, "-o", first)
    run_json("calibrate", path, "-o", again, "--radar", first)
    before, after = (open_recording(path, f).radar.channels for f in (first, again))
    np.testing.assert_allclose(after, before, atol=0.03)


def test_a_level_walk_shows_the_tilt(run_json, tmp_path):
    """The rig's own AWR1843 has a tilt of 9 degrees, by its third transmitter."""
    pytest.importorskip("embreex", reason="the extra `sim` is not installed")
    walk = simulate_sequence("hall", 3, tmp_path, frames=20)
    plain, level = tmp_path / "plain.toml", tmp_path / "level.toml"
    kept = run_json("calibrate", walk, "-o", plain)
    found = run_json("calibrate", walk, "-o", level, "--level")
    assert "tilt (deg)" not in kept
    assert found["frames that tell the tilt"] > 8
    uncertainty = found["uncertainty of the tilt (deg)"]  # of two seconds
    assert abs(found["tilt (deg)"] - 9) < 2 * uncertainty < 8
    assert "a tilt" in " ".join(kept["not observable"])
    assert "a tilt" not in " ".join(found["not observable"])
    again = run_json("calibrate", walk, "-o", plain, "--level", "--radar", level)
    assert abs(again["tilt (deg)"]) < 3


def test_what_cannot_be_calibrated_is_named(recording, tmp_path, capsys):
    path, _ = recording
    out = str(tmp_path / "out.toml")
    for wrong, code, message in (
        (["-o", str(tmp_path / "out.cfg")], 2, "expected the name of a .toml"),
        (["-o", out, "--frames", "7:9"], 2, "has frames 0 to 5"),
        (["-o", out, "--level", "--reflector", "3"], 2, "leave one out"),
        (["-o", out, "--reflector", "14.5"], 4, "reflector at 14.5 m is seen in 0"),
    ):
        assert main(["calibrate", str(path), *wrong]) == code
        assert message in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["calibrate", str(path), "-o", out, "--reflector", "3,9"])
    assert "expected a range above 0, or M,AZ,EL" in capsys.readouterr().err


def test_a_sequence_takes_the_radar_and_the_factors_of_a_file(sequence, tmp_path):
    """The file replaces the radar in ColoRadar's calib folder, not its transforms."""
    plain, file = open_recording(sequence), tmp_path / "calibrated.toml"
    factors = 1.0 + 0.1j * np.arange(plain.radar.spec.num_virtual)
    measured = dataclasses.replace(plain.radar, range_bias_m=0.05)
    write_radar_toml(file, measured.with_factors(factors))
    found = open_recording(sequence, file)
    assert found.radar.spec == plain.radar.spec and found.radar.range_bias_m == 0.05
    np.testing.assert_array_equal(found.base_from_radar, plain.base_from_radar)
    ratio = calibrate(found.cube(0), found.radar) / plain.cube(0)
    np.testing.assert_allclose(ratio[..., 1, 1].ravel(), factors, rtol=1e-3)
