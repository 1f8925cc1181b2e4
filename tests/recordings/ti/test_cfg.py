"""TI .cfg files: fields and units, firing order, dialects, the stream, clear errors."""

import numpy as np
import pytest

from jradar.radar import RadarSpec
from jradar.recordings import CaptureSpec, radar_from_cfg

CFG = """\
% a comment
sensorStop
flushCfg
dfeDataOutputMode 1
channelCfg 15 7 0
adcCfg 2 1
adcbufCfg -1 0 1 1 1
profileCfg 0 77 267 7 57.14 0 0 70 1 256 5209 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
chirpCfg 1 1 0 0 0 0 0 4
chirpCfg 2 2 0 0 0 0 0 2
frameCfg 0 2 16 0 100 1 0
guiMonitor -1 1 1 0 0 0 1
lvdsStreamCfg -1 0 1 0
sensorStart
"""
REFUSED = {
    "EsonJohn__dca1000_cf.json": "is JSON, expected a .cfg",
    "RadarHD__radarhd_config.xml": "is XML, expected a .cfg",
    "mmWaveLab__xwr1843_profile_advanced_subframe.cfg": "advanced frames",
}


@pytest.fixture
def write(tmp_path):
    """A function that writes the configuration with replacements: its path."""

    def write(*replacements, encoding="utf-8"):
        text = CFG
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "radar.cfg"
        path.write_bytes(text.encode(encoding))
        return path

    return write


def test_fields_are_in_si_units(write):
    radar = radar_from_cfg(write())
    assert radar.cube_shape == (3, 4, 16, 256)
    measured = (
        *(radar.start_frequency_hz, radar.slope_hz_per_s, radar.sample_rate_hz),
        *(radar.idle_time_s, radar.adc_start_time_s, radar.ramp_end_time_s),
        radar.frame_period_s,
    )
    expected = (77e9, 70e12, 5.209e6, 267e-6, 7e-6, 57.14e-6, 0.1)
    np.testing.assert_allclose(measured, expected)


def test_array_axis_is_the_firing_order(write):
    assert radar_from_cfg(write()).tx_positions == RadarSpec.awr1843().tx_positions
    by_bit = write(
        ("1 1 0 0 0 0 0 4", "1 1 0 0 0 0 0 2"),
        ("2 2 0 0 0 0 0 2", "2 2" + 5 * " 0" + " 4"),
    )
    radar = radar_from_cfg(by_bit)
    assert radar.tx_positions == ((0, 0), (2, 1), (4, 0))
    assert radar.tx_firing_order == (0, 1, 2)


@pytest.mark.parametrize(
    ("device", "changes", "positions"),
    [
        ("awr1443", [], ((0, 0), (4, 0), (2, 1))),
        (
            "awr1642",
            [
                ("chirpCfg 1 1 0 0 0 0 0 4", "chirpCfg 1 1 0 0 0 0 0 2"),
                ("0 2 16", "0 1 16"),
            ],
            ((0, 0), (4, 0)),
        ),
        ("iwr6843isk", [("0 77 ", "0 60.25 ")], ((0, 0), (4, 0), (2, 1))),
    ],
)
def test_each_board_has_its_positions(write, device, changes, positions):
    radar = radar_from_cfg(write(*changes), device=device)
    assert (radar.name, radar.tx_positions) == (device, positions)
    assert 0.48 < radar.spacing_wavelengths < 0.52


def test_receivers_that_are_off_are_left_out(write):
    radar = radar_from_cfg(write(("channelCfg 15", "channelCfg 10")))
    assert radar.rx_positions == ((1, 0), (3, 0))


@pytest.mark.parametrize(
    "changes",
    [
        [("\n", "\r\n")],
        [(" ", "\t ")],
        [("sensorStart", "sensorStart % started"), ("15 7 0", "15 7 0 # all on")],
        [("0 2 16 0 100 1 0", "0.0 2.0 16.00 0 100")],
        [("15 7 0", "15 7"), ("5209 0 0 30", "5209"), ("-1 0 1 1 1", "0 1 0 1")],
        [("adcCfg 2 1", "adcCfg 2 0\nadcCfg 2 1"), ("% a", "\ufeff% a")],
        [("% a", "frameCfg 0 1 8 0 50\n% a")],
        [("chirpCfg 0 0", "profileCfg 1 76 9 7 58 0 0 60 1 64 5209\nchirpCfg 0 0")],
    ],
)
def test_dialects_describe_the_same_radar(write, changes):
    plain = radar_from_cfg(write())
    assert radar_from_cfg(write(*changes)) == plain


def test_comments_may_be_in_another_encoding(write):
    path = write(("a comment", "10 µs"), encoding="cp1252")
    assert radar_from_cfg(path).num_samples == 256


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("profileCfg", "profile", "no profileCfg: is it a .cfg of"),
        ("adcCfg 2 1", "adcCfg 2 0", "selects real samples"),
        ("adcbufCfg -1 0", "adcbufCfg -1 1", "selects real samples"),
        ("Mode 1", "Mode 3", "advanced frames"),
        ("frameCfg", "advFrameCfg 1 0\nsubFrameCfg 0 0 0 1\nframeCfg", "advanced fr"),
        ("Mode 1", "Mode 2", "dfeDataOutputMode 2, expected 1"),
        ("0 0 0 0 0 4", "0 0 0 0 0 5", r"\[\[0\], \[0, 2\], \[1\]\], expected each"),
        ("0 0 0 0 0 4", "0 0 0 0 0 1", "each transmitter to fire once"),
        ("0 0 0 0 0 4", "0 0 0 0 0 0", "expected each chirp to fire one"),
        ("0 0 0 0 0 4", "0 5 0 0 0 4", "differ in profile, frequency, slope"),
        ("2 2 0 0 0", "2 2 1 0 0", "differ in profile, frequency, slope"),
        ("profileCfg 0", "profileCfg 3", r"use profile 0, profileCfg describes \[3\]"),
        ("0 2 16", "0 3 16", r"chirps 0 to 3, chirpCfg describes \[0, 1, 2\]"),
        ("0 2 16", "2 0 16", "chirps 2 to 0"),
        ("0 2 16", "0 2 16.5", "frameCfg holds 16.5, expected a whole number"),
        ("0 2 16", "0 2 0", "radar.cfg: num_chirps = 0, expected more"),
        ("chirpCfg 1 1", "chirpCfg 1 1e9", "chirpCfg holds 1e[+]09, expected a whole"),
        ("15 7 0", "15 5 0", r"transmitters \[0, 2\], the frame needs"),
        ("15 7 0", "0 7 0", r"receivers \[\] and"),
        ("15 7 0", "15", "line 5: 'channelCfg 15', expected at least 2 numbers"),
        ("256", "many", "line 8: profileCfg: could not convert"),
        ("256", "nan", "line 8: .* expected at least 11 numbers"),
        ("57.14", "50", "radar.cfg: sampling ends 56.15 us into the chirp"),
        ("0 77 ", "0 60 ", "start at 60.0 GHz, the awr1843 works from 76 to 81 GHz"),
    ],
)
def test_unusable_configuration_is_refused(write, old, new, message):
    with pytest.raises(ValueError, match=message):
        radar_from_cfg(write((old, new)))


def test_unknown_or_other_board_is_refused(write):
    with pytest.raises(ValueError, match="'iwr6843': name the board, .* iwr6843ods"):
        radar_from_cfg(write(), device="iwr6843")
    with pytest.raises(ValueError, match=r"\[0, 2, 1\], the awr1642 has 2"):
        radar_from_cfg(write(), device="awr1642")


def test_complex_2x_warns_of_the_image_band(write):
    with pytest.warns(UserWarning, match="upper half of the range bins"):
        radar_from_cfg(write(("adcCfg 2 1", "adcCfg 2 2")))


def test_order_of_samples_in_the_stream(write):
    capture = CaptureSpec.from_cfg(write())
    assert capture.iq_order == "QQII" and not capture.has_headers
    assert (capture.range_bias_m, capture.channel_factors) == (0.0, (1,) * 12)
    old = write(("-1 0 1 1 1", "0 0 0 1"), ("Cfg -1 0 1 0", "Cfg -1 1 1 0"))
    capture = CaptureSpec.from_cfg(old)
    assert capture.iq_order == "I4Q4" and capture.has_headers
    assert hash(capture) == hash(CaptureSpec.from_cfg(old))


def test_factors_follow_the_firing_order_and_the_receivers(write):
    factors = np.arange(12) + 1j * np.arange(12, 24)
    halves = " ".join(f"{f.real} {f.imag}" for f in factors)
    command = f"compRangeBiasAndRxChanPhase 0.07 {halves}\nsensorStart"
    path = write(("sensorStart", command))
    capture = CaptureSpec.from_cfg(path)
    by_bit = factors.reshape(3, 4)
    assert capture.range_bias_m == 0.07
    np.testing.assert_array_equal(capture.channel_factors, by_bit[[0, 2, 1]].ravel())
    path = write(("sensorStart", command), ("0 2 16", "0 1 16"), ("15 7", "10 5"))
    capture = CaptureSpec.from_cfg(path)
    expected = by_bit[[0, 2]][:, [1, 3]].ravel()
    np.testing.assert_array_equal(capture.channel_factors, expected)


@pytest.mark.parametrize(
    ("halves", "message"),
    [("0.1 1 0 1", "3 numbers after the bias"), ("0.1 1 0 1 0", "holds 2 complex")],
)
def test_incomplete_factors_are_refused(write, halves, message):
    command = f"compRangeBiasAndRxChanPhase {halves}\nsensorStart"
    with pytest.raises(ValueError, match=message):
        CaptureSpec.from_cfg(write(("sensorStart", command)))


ODS_SIGNS = np.tile([1, -1, -1, 1], 3)
FACTORS = "compRangeBiasAndRxChanPhase 0.0" + " 1 0 -1 0" * 6


@pytest.mark.parametrize(
    ("commands", "expected"),
    [
        ("", ODS_SIGNS),
        ("compRangeBiasAndRxChanPhase 0.0" + " 1 0" * 12, ODS_SIGNS),
        (FACTORS, np.tile([1, -1], 6)),  # measured ones include the signs
        (FACTORS + "\nantPhaseRot" + " 1 -1 -1 1" * 3, np.tile([1, 1, -1, -1], 3)),
    ],
    ids=["none", "neutral", "measured", "separate"],
)
def test_inverted_receivers_are_undone_once(write, commands, expected):
    path = write(("sensorStart", f"{commands}\nsensorStart"), ("0 77 ", "0 60.25 "))
    radar = radar_from_cfg(path, device="iwr6843ods")
    assert radar.rx_positions == ((0, 0), (0, -1), (1, -1), (1, 0))
    capture = CaptureSpec.from_cfg(path, device="iwr6843ods")
    np.testing.assert_array_equal(capture.channel_factors, expected)
    assert capture.channel_array is not None


@pytest.mark.parametrize("signs", ["1 -1", "1 0 " * 6, "2 " * 12])
def test_unusable_signs_are_refused(write, signs):
    path = write(("sensorStart", f"antPhaseRot {signs}"), ("0 77 ", "0 60.25 "))
    with pytest.raises(ValueError, match="antPhaseRot holds .* each 1 or -1"):
        CaptureSpec.from_cfg(path, device="iwr6843ods")


def test_a_board_with_real_samples(write):
    """As TI's profile_LVDS.cfg for the AWR2944, with 8 fields after frameCfg."""
    path = write(
        ("adcCfg 2 1", "adcCfg 2 0"),
        ("adcbufCfg -1 0", "adcbufCfg -1 1"),
        ("1 256 5209", "1 560 11396"),
        ("0 2 16 0 100 1 0", "0 2 16 20 560 100 1 0"),
    )
    radar = radar_from_cfg(path, device="awr2944")
    assert radar.real_samples and radar.cube_shape == (3, 4, 16, 560)
    assert radar.tx_positions == ((0, 0), (4, 0), (2, 1)) and radar.row_spacing == 1.6
    assert radar.frame_period_s == 0.1 and radar.num_range_bins == 280
    assert CaptureSpec.from_cfg(path, device="awr2944").iq_order == "I"
    with pytest.raises(ValueError, match="selects real samples, expected complex"):
        radar_from_cfg(path, device="awr1843")
    with pytest.raises(ValueError, match="selects complex samples, expected real"):
        radar_from_cfg(write(), device="awr2944")


def test_every_real_file_is_read_or_refused_with_the_reason(samples):
    paths = sorted((samples / "cfg").iterdir())
    assert len(paths) == 35
    for path in paths:
        if path.name in REFUSED:
            with pytest.raises(ValueError, match=REFUSED[path.name]):
                radar_from_cfg(path)
            continue
        if "6843" in path.name:
            with pytest.raises(ValueError, match="start at 60.0 GHz"):
                radar_from_cfg(path)
        device = "iwr6843isk" if "6843" in path.name else "awr1843"
        radar = radar_from_cfg(path, device=device)
        capture = CaptureSpec.from_cfg(path, device=device)
        assert radar.num_rx == 4
        assert len(capture.channel_factors) == radar.num_virtual
        assert 0.04 < radar.range_resolution_m < 0.5
        assert 0 < radar.num_chirps * radar.turn_period_s <= radar.frame_period_s


def test_real_calibrated_file(samples):
    path = samples / "cfg" / "radarize_ae__1843_v1.cfg"
    radar, capture = radar_from_cfg(path), CaptureSpec.from_cfg(path)
    assert radar.tx_positions == RadarSpec.awr1843().tx_positions
    assert radar.cube_shape == (3, 4, 32, 96)
    assert radar.frame_period_s == pytest.approx(1 / 30, abs=1e-6)
    assert capture.range_bias_m == 0.0658967
    assert capture.channel_factors[4] == 0.85019 + 0.05954j  # ninth in the file
