"""Scripts of mmWave Studio: what is read, what is refused by line; real captures."""

import functools

import numpy as np
import pytest

from jradar.errors import UsageError
from jradar.recordings import open_recording, read_description
from jradar.recordings.ti.lua import read_lua
from tests.recordings.coloradar_writer import write
from tests.recordings.lua_writer import COM304, COM405, script


@pytest.fixture
def lua(tmp_path):
    """A function that writes a script: its path."""
    return functools.partial(write, tmp_path / "capture.lua")


def test_the_values_of_a_script(lua):
    radar, capture, notes = read_description(lua(script()))
    assert notes == () and radar.name == "awr1843"
    assert radar.cube_shape == (3, 4, 1, 512)
    # Transmitters in firing order: 1 (elevated), 0, 2.
    assert radar.tx_positions == ((2, 1), (0, 0), (4, 0))
    assert radar.start_frequency_hz == 77e9 and radar.frame_period_s == 0.02
    assert radar.slope_hz_per_s == pytest.approx(70.15e12)
    assert radar.sample_rate_hz == 10e6
    assert radar.chirp_period_s == pytest.approx(64e-6)
    assert radar.adc_start_time_s == pytest.approx(5.28e-6)
    assert radar.range_resolution_m == pytest.approx(0.0418, abs=1e-4)
    assert (capture.iq_order, capture.lanes, capture.frames) == ("IIQQ", 2, 20)
    other = read_description(lua(script(COM405))).capture
    assert (other.lanes, other.frames) == (4, 1000)


def test_the_board_is_that_of_the_chip_or_of_the_user(lua):
    four = read_description(lua(script(chip="XWR1443")))
    assert four.radar.name == "awr1443" and four.capture.iq_order == "I4Q4"
    unknown = read_description(lua(script(chip="AR1243")))
    assert unknown.radar.name == "awr1843"
    assert "names no chip that is known" in unknown.notes[0]
    path = lua(script(chip="IWR6843").replace("START_FREQ = 77", "START_FREQ = 60"))
    with pytest.raises(UsageError, match="IWR6843 is on several boards.*iwr6843isk"):
        read_description(path)
    ods = read_description(path, device="iwr6843ods")
    assert ods.radar.name == "iwr6843ods" and ods.notes == ()
    assert ods.capture.channel_factors == (1, -1, -1, 1) * 3
    with pytest.raises(UsageError, match="device = 'radar', expected one of"):
        read_lua(path, device="radar")


def test_receivers_transmitters_and_order_of_i_and_q(lua):
    text = script().replace(
        "(1, 1, 1, 1, 1, 1, 1, 2, 1, 0)", "(1,1,1, 1,0,1,1, 2, 1, 1)"
    )
    radar, capture, _ = read_description(lua(text))
    assert radar.rx_positions == ((0, 0), (2, 0), (3, 0))
    assert capture.iq_order == "QQII"
    off = script().replace("(1, 1, 1, 1, 1, 1, 1,", "(1, 1, 0, 1, 1, 1, 1,")
    with pytest.raises(ValueError, match=r"transmitters \[0, 1\] are enabled"):
        read_description(lua(off))


def test_complex_2x_samples_are_named(lua):
    path = lua(script().replace("1, 2, 1, 0)", "1, 2, 2, 0)"))
    with pytest.warns(UserWarning, match="upper half of the range bins is the image"):
        read_lua(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "SLOPE, 0, NUM",
            "SLOPE + 1, 0, NUM",
            "line 15: ProfileConfig: 'SLOPE . 1' is",
        ),
        ("= 70.15", "= 70 + slope", "line 15: .*'SLOPE = 70 . slope' is neither"),
        ("NUM_SAMPLES = 512", "", "line 15: .*'NUM_SAMPLES' is neither a number"),
        ("SAMPLES = 512", "SAMPLES = 8\nNUM_SAMPLES = 9", "line 16: .* several values"),
        ("FREQ, 7,", "FREQ, f(7),", "line 15: .*expected 18 arguments, each a number"),
        ("FREQ, 7,", "FREQ,", "line 15: .*expected 18 arguments"),
        ("FREQ, 7,", "FREQ, 1e999,", "line 15: .*1e999, expected at most 4.29"),
        ("Config(0, START", "Config(0.5, START", "line 15: .*its number = 0.5, expect"),
        ("Config(2, 2,", "Config(1, 1,", "line 21: ChirpConfig differs from line 20"),
        ("Config(2, 2,", "Config(2, 600,", "line 21: .*chirps 2 to 600"),
        ("(0, 2, 20,", "(0, 3, 20,", "a frame sends chirps 0 to 3"),
        ("1, 2, 1, 0)", "1, 2, 0, 0)", "line 9: ChanNAdcConfig selects format 0"),
        ("ar1.FrameConfig", "ar1.AdvanceFrameConfig", "no ar1.FrameConfig: is it a s"),
        ("ar1.FrameConfig", "-- ar1.FrameConfig", "no ar1.FrameConfig: is it a scrip"),
        ("1216644097", "1216644150", "line 12: DataPathConfig sends content 54"),
        ("(513,", "(0,", "line 12: .*interface 0, expected samples alone over LVDS"),
    ],
)
def test_other_forms_are_refused_by_line(lua, old, new, message):
    assert script().count(old) == 1
    with pytest.raises(ValueError, match=f"(?s)capture.lua.*{message}"):
        read_description(lua(script().replace(old, new)))


def test_a_call_that_is_repeated_as_it_is(lua):
    more = "ar1.ChirpConfig(2, 2, 0, 0, 0, 0, 0, 0, 0, 1)\n"
    text = script() + more + "pcall(function() return ar1.LPModConfig(0, x) end)\n"
    assert read_description(lua(text)).radar.num_tx == 3
    hexadecimal = script().replace("NUM_SAMPLES = 512", "NUM_SAMPLES = 0x200")
    assert read_description(lua(hexadecimal)).radar.num_samples == 512


@pytest.mark.parametrize(
    ("name", "bins"), [("1_Raw_0.bin", None), ("2_Raw_0.bin", (9, 16))]
)
def test_real_captures_of_a_course(samples, tmp_path, name, bins):
    """A script next to the capture; the peaks of a scene that stands still."""
    folder = samples / "com304"
    if not folder.is_dir():
        pytest.skip("no com304 among the samples")
    (tmp_path / name).write_bytes((folder / name).read_bytes())
    (tmp_path / "script.lua").write_text(script(COM304))
    recording = open_recording(tmp_path / name)
    assert len(recording.cubes) == 20 and recording.notes == ()
    cube = np.stack([*recording.cubes])
    spectrum = np.fft.fft((cube - cube.mean(-1, keepdims=True)) * np.hanning(512))
    power = (np.abs(spectrum) ** 2).mean((0, 1, 2, 3))
    front, back = power[3:256].sum(), power[257:-3].sum()
    assert 10 * np.log10(front / back) > 25
    if bins is not None:
        inner = power[4:60]
        peaks = 4 + np.flatnonzero((inner > power[3:59]) & (inner > power[5:61]))
        strongest = sorted(peaks[np.argsort(power[peaks])[-2:]])
        assert tuple(strongest) == bins
        metres = np.array(strongest) * recording.radar.spec.range_resolution_m
        np.testing.assert_allclose(metres, [0.38, 0.67], atol=0.01)
