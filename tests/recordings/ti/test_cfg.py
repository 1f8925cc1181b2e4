"""TI .cfg files: dialects, the stream of samples, factors of channels, clear errors."""

import numpy as np
import pytest

from jradar.radar import RadarSpec
from jradar.recordings.ti.cfg import read_cfg
from tests.recordings.dca1000_writer import CFG, SHAPE

REFUSED = {
    "EsonJohn__dca1000_cf.json": "is JSON, expected a .cfg",
    "RadarHD__radarhd_config.xml": "is XML, expected a .cfg",
    "mmWaveLab__xwr1843_profile_advanced_subframe.cfg": "advanced frames",
}
FACTORS = np.arange(12) + 1j * np.arange(12, 24)
COMMAND = "compRangeBiasAndRxChanPhase 0.07 "
COMMAND += " ".join(f"{f.real} {f.imag}" for f in FACTORS)


@pytest.fixture
def read(tmp_path):
    """A function that reads the configuration with replacements."""

    def read(*replacements, more="", encoding="utf-8", device="awr1843"):
        text = CFG + more
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "radar.cfg"
        path.write_bytes(text.encode(encoding))
        return read_cfg(path, device=device)

    return read


@pytest.mark.parametrize(
    "changes",
    [
        [],
        [("\n", "\r\n")],
        [(" ", "\t ")],
        [("frameCfg", "% a comment\nsensorStop\nframeCfg"), ("7 0", "7 0 # all on")],
        [("0 2 5 0 100 1 0", "0.0 2.0 5.00 0 100")],
        [("15 7 0", "15 7"), ("5209 0 0 30", "5209"), ("-1 0 0 1 1", "0 0 0 1")],
        [("adcCfg 2 1", "adcCfg 2 0\nadcCfg 2 1"), ("channel", "\ufeffchannel")],
        [("frameCfg", "frameCfg 0 1 8 0 50\nframeCfg")],
        [("channelCfg", "frameCfg 0 9 8 0 5\nflushCfg\nchannelCfg")],
        [("chirpCfg 0 0", "profileCfg 1 76 9 7 58 0 0 60 1 64 5209\nchirpCfg 0 0")],
    ],
)
def test_dialects_describe_the_same_radar(read, changes):
    radar, _ = read(*changes)
    assert radar.cube_shape == SHAPE and radar.name == "awr1843"
    assert radar.tx_firing_order == (0, 1, 2)
    assert radar.tx_positions == RadarSpec.awr1843().tx_positions
    assert (radar.start_frequency_hz, radar.slope_hz_per_s) == (77e9, 70e12)
    assert (radar.sample_rate_hz, radar.frame_period_s) == (5.209e6, 0.1)
    times = (radar.idle_time_s, radar.adc_start_time_s, radar.ramp_end_time_s)
    np.testing.assert_allclose(times, (267e-6, 7e-6, 57.14e-6))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("profileCfg", "profile", "no profileCfg: is it a .cfg of"),
        ("adcCfg 2 1", "adcCfg 2 0", "selects real samples, expected complex"),
        ("adcbufCfg -1 0", "adcbufCfg -1 1", "selects real samples"),
        ("adcCfg", "dfeDataOutputMode 3\nadcCfg", "advanced frames"),
        ("frameCfg", "advFrameCfg 1 0\nsubFrameCfg 0 0 0 1\nframeCfg", "advanced fr"),
        ("adcCfg", "dfeDataOutputMode 2\nadcCfg", "dfeDataOutputMode 2, expected 1"),
        ("15 7 0", "15", "line 1: 'channelCfg 15', expected at least 2 numbers"),
        ("10 5209", "many 5209", "line 4: profileCfg: could not convert"),
        ("10 5209", "nan 5209", "line 4: .* expected at least 11 numbers"),
        ("frameCfg", f"{COMMAND} 1\nframeCfg", "25 numbers after the bias, expected"),
        ("frameCfg", f"{COMMAND[:50]}\nframeCfg", "parts of 12 factors or more"),
        *(
            ("frameCfg", f"antPhaseRot {signs}\nframeCfg", "holds .* each 1 or -1")
            for signs in ("1 -1", "1 0 " * 6, "2 " * 12)
        ),
    ],
)
def test_unusable_configuration_is_refused(read, old, new, message):
    with pytest.raises(ValueError, match=f"radar.cfg.*{message}"):
        read((old, new))


def test_complex_2x_warns_of_the_image_band(read):
    with pytest.warns(UserWarning, match="upper half of the range bins"):
        read(("adcCfg 2 1", "adcCfg 2 2"))


def test_headers_in_the_stream_and_comments_in_another_encoding(read):
    _, capture = read(more="% 10 µs\n", encoding="cp1252")
    assert not capture.has_headers
    assert (capture.range_bias_m, capture.channel_factors) == (0.0, (1,) * 12)
    _, capture = read(more="lvdsStreamCfg -1 1 1 0\n")
    assert capture.has_headers and hash(capture) != hash(read()[1])


def test_factors_follow_the_firing_order_and_the_receivers(read):
    by_bit = FACTORS.reshape(3, 4)
    capture = read(more=COMMAND)[1]
    assert capture.range_bias_m == 0.07
    np.testing.assert_array_equal(capture.channel_factors, by_bit[[0, 2, 1]].ravel())
    capture = read(("0 2 5", "0 1 5"), ("15 7", "10 5"), more=COMMAND)[1]
    expected = by_bit[[0, 2]][:, [1, 3]].ravel()
    np.testing.assert_array_equal(capture.channel_factors, expected)


MEASURED = "compRangeBiasAndRxChanPhase 0.0" + " 1 0 -1 0" * 6


@pytest.mark.parametrize(
    ("commands", "expected"),
    [
        ("", [1, -1, -1, 1]),
        ("compRangeBiasAndRxChanPhase 0.0" + " 1 0" * 12, [1, -1, -1, 1]),
        (MEASURED, [1, -1, 1, -1]),  # measured ones include the signs
        (MEASURED + "\nantPhaseRot" + " 1 -1 -1 1" * 3, [1, 1, -1, -1]),
    ],
    ids=["none", "neutral", "measured", "separate"],
)
def test_inverted_receivers_are_undone_once(read, commands, expected):
    radar, capture = read(("0 77 ", "0 60.25 "), more=commands, device="iwr6843ods")
    assert radar.rx_positions == ((0, 0), (0, -1), (1, -1), (1, 0))
    np.testing.assert_array_equal(capture.channel_factors, np.tile(expected, 3))
    assert capture.radar(radar).calibrated


def test_a_board_with_real_samples(read):
    """As TI's profile_LVDS.cfg for the AWR2944, with 8 fields after frameCfg."""
    changes = [
        ("adcCfg 2 1", "adcCfg 2 0"),
        ("adcbufCfg -1 0", "adcbufCfg -1 1"),
        ("1 10 5209", "1 560 11396"),
        ("0 2 5 0 100 1 0", "0 2 5 20 560 100 1 0"),
    ]
    radar, capture = read(*changes, device="awr2944")
    assert radar.real_samples and radar.cube_shape == (3, 4, 5, 560)
    assert radar.frame_period_s == 0.1 and radar.num_range_bins == 280
    assert capture.iq_order == "I"
    with pytest.raises(ValueError, match="selects complex samples, expected real"):
        read(device="awr2944")


def test_every_real_file_is_read_or_refused_with_the_reason(samples):
    paths = sorted((samples / "cfg").iterdir())
    assert len(paths) == 35
    for path in paths:
        if path.name in REFUSED:
            with pytest.raises(ValueError, match=REFUSED[path.name]):
                read_cfg(path)
            continue
        if "6843" in path.name:
            with pytest.raises(ValueError, match="at 60 GHz, the awr1843 has 3"):
                read_cfg(path)
        device = "iwr6843isk" if "6843" in path.name else "awr1843"
        radar, capture = read_cfg(path, device=device)
        assert radar.num_rx == 4
        assert len(capture.channel_factors) == radar.num_virtual
        assert 0.04 < radar.range_resolution_m < 0.5
        assert 0 < radar.num_chirps * radar.turn_period_s <= radar.frame_period_s


def test_real_calibrated_file(samples):
    radar, capture = read_cfg(samples / "cfg" / "radarize_ae__1843_v1.cfg")
    assert radar.tx_positions == RadarSpec.awr1843().tx_positions
    assert radar.cube_shape == (3, 4, 32, 96)
    assert radar.frame_period_s == pytest.approx(1 / 30, abs=1e-6)
    assert capture.range_bias_m == 0.0658967
    assert capture.channel_factors[4] == 0.85019 + 0.05954j  # ninth in the file
