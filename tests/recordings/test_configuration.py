"""`jradar info profile.cfg`: what a radar measures, and what its board can run."""

import dataclasses
import subprocess
import sys
import warnings

import pytest

from jradar.radar import Radar, RadarSpec
from jradar.recordings import describe_configuration, write_radar_toml
from jradar.recordings.configuration import board_checks, link_mbps
from tests.recordings.lua_writer import FOUR_LANES, TWO_LANES, script

SPEC = RadarSpec.awr1843(frame_period_s=0.1)


def test_models_are_compared_without_jax(tmp_path):
    path = tmp_path / "radar.toml"
    write_radar_toml(path, Radar(SPEC))
    assert "jradar-sim" in describe_configuration(path)["models"]
    heavy = "jax", "matplotlib", "scipy.optimize", "scipy.spatial", "scipy.special"
    code = (
        "import sys; from jradar.cli import main; "
        f"main(['info', {str(path)!r}]) and sys.exit('info failed'); "
        f"sys.exit(' '.join({{*{heavy}}} & {{*sys.modules}}) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("file", ["mmwave_ti_ros__1843_3d", "RadarHD"])
def test_a_configuration_is_described_with_a_verdict(samples, file):
    (path,) = (samples / "cfg").glob(f"*{file}.cfg")
    found = describe_configuration(path)
    elevation = file != "RadarHD"
    assert found["radar"]["measures elevation"] == elevation
    assert found["the board can run it"] == "yes"
    assert {"jradar-sim", "jradar-sim-diffusion"} <= {*found["models"]}
    reason = "other radars" if elevation else "no elevation"
    assert reason in found["models"]["jradar-sim"]
    assert "no elevation" not in found["models"]["radarhd"]  # which needs none
    assert "jradar-maps" not in found["models"]  # which sees no radar's frames


@pytest.mark.parametrize("lanes", [TWO_LANES, FOUR_LANES])
def test_four_lanes_are_named_before_anything_is_recorded(tmp_path, lanes):
    path = tmp_path / "capture.lua"
    path.write_text(script(lanes=lanes))
    notes = describe_configuration(path)["notes"]
    lost = ["half of the samples may be lost" in note for note in notes]
    assert lost == [True] * (lanes == FOUR_LANES)
    path.write_text(script(lanes=lanes, chip="XWR1443"))
    assert describe_configuration(path)["notes"] == []


@pytest.mark.parametrize(
    ("changes", "failed"),
    [
        ({}, []),
        ({"frame_period_s": 0.0}, []),
        ({"num_chirps": 129}, ["frame in memory (KiB)"]),  # 128 x 128 is the most
        ({"frame_period_s": 0.0499}, ["chirps in the period (%)"]),
        ({"idle_time_s": 7e-6, "frame_period_s": 0.0153}, ["duty cycle (%)"]),
        ({"slope_hz_per_s": 201e12, "start_frequency_hz": 76e9},
         ["bandwidth (GHz)"]),
        ({"start_frequency_hz": 79.1e9}, ["end of the ramp (GHz)"]),
    ],
)  # fmt: skip
def test_each_limit_of_a_board_is_named(changes, failed):
    spec = dataclasses.replace(SPEC, **changes)
    assert [c.check for c in board_checks(spec) if not c.fits] == failed


def test_the_link_carries_the_samples_of_each_second():
    # 3 x 4 x 128 x 128 samples of 4 bytes, ten times a second
    assert link_mbps(SPEC) == pytest.approx(62.9, abs=0.05)
    quick = dataclasses.replace(SPEC, idle_time_s=0.0, frame_period_s=0.009)
    assert "link (Mbit/s)" in [c.check for c in board_checks(quick) if not c.fits]


def test_all_samples_have_a_verdict_or_a_reason(samples):
    described = 0
    for path in sorted((samples / "cfg").iterdir()):
        device = "iwr6843ods" if "6843" in path.name else None
        device = "awr1443" if "1443" in path.name else device
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                found = describe_configuration(path, device=device)
            except ValueError as error:
                assert path.name in str(error)
                continue
        described += 1
        assert found["the board can run it"] == "yes", path  # all of them were run
    assert described == 32  # of 35: a capture card, an XML file, advanced frames
