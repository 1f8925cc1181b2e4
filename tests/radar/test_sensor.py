"""RadarSpec: derived quantities against published ones, files, and clear errors."""

import dataclasses
import math

import numpy as np
import pytest

from jradar.radar import RadarSpec
from jradar.recordings import radar_from_studio_log, radar_from_toml

TOML = """
[radar]
device = "awr1642"
num_chirps = 64
tx_positions = [[0, 0], [4, 0]]
"""


def test_single_chip_has_published_resolutions():
    radar = RadarSpec.awr1843()
    assert radar.range_resolution_m == pytest.approx(0.124905712903, rel=1e-6)
    assert radar.max_range_m == pytest.approx(15.99, abs=0.01)
    # Published figures put the wavelength at the start of the sweep, not its middle.
    start = radar.center_frequency_hz / radar.start_frequency_hz
    assert radar.max_velocity_mps * start == pytest.approx(2.496, abs=1e-3)
    assert radar.velocity_resolution_mps * start == pytest.approx(0.0390, abs=1e-4)


def test_cascade_has_published_resolutions_and_aperture():
    radar = RadarSpec.cascade()
    assert radar.range_resolution_m == pytest.approx(0.0592943951488, rel=1e-6)
    assert radar.virtual_positions.max(0).tolist() == [85, 6]
    assert len(np.unique(radar.virtual_positions, axis=0)) == 134
    assert radar.cube_shape == (12, 16, 16, 256)


def test_single_chip_virtual_array_is_two_rows():
    positions = RadarSpec.awr1843().virtual_positions
    rows = [positions[positions[:, 1] == row, 0].tolist() for row in (0, 1)]
    assert rows == [[0, 1, 2, 3, 4, 5, 6, 7], [2, 3, 4, 5]]
    assert RadarSpec.awr1843().has_elevation
    assert not RadarSpec.awr1642().has_elevation


def test_firing_position_inverts_the_firing_order():
    radar = RadarSpec.cascade()
    assert tuple(np.argsort(radar.firing_position)) == radar.tx_firing_order
    assert radar.firing_position[3] == 9  # the first elevated one fires tenth


def test_a_board_and_a_waveform_make_a_radar():
    waveform = {
        name: value
        for name, value in dataclasses.asdict(RadarSpec.awr1843()).items()
        if not name.startswith(("name", "tx", "rx", "design"))
    }
    isk = RadarSpec.named("iwr6843isk", **waveform)
    assert (isk.name, isk.tx_positions[1]) == ("iwr6843isk", (2, 1))
    assert isk.design_frequency_hz == 62e9
    in_mask_order = ((0, 0), (2, 1), (4, 0))
    assert RadarSpec.named("awr1843", tx_positions=in_mask_order) == (
        dataclasses.replace(RadarSpec.named("awr1443", **waveform), name="awr1843")
    )


def test_a_simple_radar_has_the_textbooks_resolutions():
    """A 24 GHz board: 250 MHz in 0.5 ms, four receivers, one transmitter."""
    radar = RadarSpec.simple(
        start_frequency_hz=24.0e9,
        bandwidth_hz=250e6,
        chirp_s=0.5e-3,
        num_samples=256,
        num_chirps=32,
        num_rx=4,
        period_s=1e-3,
        name="24 GHz",
    )
    assert radar.range_resolution_m == pytest.approx(299_792_458 / (2 * 250e6))
    assert radar.max_velocity_mps == pytest.approx(299_792_458 / 24.125e9 / 4e-3)
    assert radar.spacing_wavelengths == pytest.approx(0.5)
    assert (radar.name, radar.cube_shape) == ("24 GHz", (1, 4, 32, 256))
    with pytest.raises(ValueError, match="idle_time_s = -0.0004"):
        RadarSpec.simple(
            start_frequency_hz=24e9,
            bandwidth_hz=250e6,
            chirp_s=0.5e-3,
            num_samples=256,
            num_chirps=32,
            period_s=1e-4,
        )


def test_spec_is_hashable_and_equal_by_value():
    assert hash(RadarSpec.awr1843()) == hash(RadarSpec.awr1843())
    assert RadarSpec.awr1843() != RadarSpec.awr1843(num_chirps=64)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"device": "awr1834"}, r"device = 'awr1834', .*: did you mean 'awr1843'\?"),
        ({"device": "awr1443"}, "missing radar fields: start_frequency_hz"),
        ({"device": "awr1843", "num_chirp": 3}, "'num_chirp', expected num_chirps"),
        ({"device": "awr1843", "num_chirps": 1.5}, "num_chirps = 1.5, expected an int"),
        (
            {"device": "awr1843", "num_chirps": 0},
            "num_chirps = 0, expected more than 0",
        ),
        ({"device": "awr1843", "idle_time_s": -1}, "idle_time_s = -1.0, expected 0 or"),
        ({"device": "awr1843", "slope_hz_per_s": float("nan")}, "slope_hz_per_s = nan"),
        ({"device": "awr1843", "ramp_end_time_s": 13e-6}, "after ramp_end_time_s"),
        ({"device": "awr1843", "tx_positions": [[0, 0.5]]}, "whole numbers"),
        ({"device": "awr1843", "tx_positions": 3}, "tx_positions = 3, expected a list"),
        (
            {"device": "awr1843", "tx_firing_order": [0, 1]},
            "each of the 3 transmitters",
        ),
        ({"num_chirps": 3}, "missing radar fields: start_frequency_hz"),
    ],
)
def test_impossible_radar_is_refused(values, message):
    with pytest.raises(ValueError, match=message):
        RadarSpec.from_dict(values)


def test_toml_names_a_device_and_changes_it(tmp_path):
    path = tmp_path / "radar.toml"
    path.write_text(TOML)
    assert radar_from_toml(path) == RadarSpec.awr1642(num_chirps=64)
    path.write_text(TOML + "slope = 3")
    with pytest.raises(ValueError, match="radar.toml: unknown radar field 'slope'"):
        radar_from_toml(path)
    path.write_text("[radar")
    with pytest.raises(ValueError, match="not a TOML file"):
        radar_from_toml(path)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ValueError, match="not a text file"):
        radar_from_toml(path)


@pytest.mark.parametrize("device", ["[]", "4", "true", "{a = 1}"])
def test_a_device_that_is_no_name(tmp_path, device):
    path = tmp_path / "radar.toml"
    path.write_text(f"[radar]\ndevice = {device}\n")
    with pytest.raises(ValueError, match="radar.toml: device = .*, expected a text"):
        radar_from_toml(path)


@pytest.mark.parametrize("radar", ["radar = 3", "radar = []", "[[radar]]\nname = 'a'"])
def test_a_radar_that_is_no_table(tmp_path, radar):
    path = tmp_path / "radar.toml"
    path.write_text(radar)
    with pytest.raises(ValueError, match=r"radar.toml: radar = .*, expected a table"):
        radar_from_toml(path)


LOG = """\
01-Jan-2026 10:00:00: API:select_chip_version,AR1843,0,
01-Jan-2026 10:00:00: API:ChannelConfig,7,15,0,
01-Jan-2026 10:00:00: API:AdcOutConfig,2,1,0,
API:ProfileConfig,0,1435384036,10000,600,6000,0,0,621,0,256,10000,0,0,30,0,
01-Jan-2026 10:00:00: API:ChirpConfig,0,0,0,0,0,0,0,1,0,0,
01-Jan-2026 10:00:00: API:ChirpConfig,1,1,0,0,0,0,0,0,0,1,
01-Jan-2026 10:00:00: API:ChirpConfig,2,2,0,0,0,0,0,0,1,0,
01-Jan-2026 10:00:00: API:FrameConfig,0,2,8,64,200000,0,512,0,
"""


def test_studio_log_gives_transmitters_in_firing_order(tmp_path):
    path = tmp_path / "log.txt"
    path.write_text(LOG)
    radar = radar_from_studio_log(path)
    assert radar.tx_positions == RadarSpec.awr1843().tx_positions
    assert radar.start_frequency_hz == pytest.approx(77e9, rel=1e-6)
    assert radar.slope_hz_per_s == pytest.approx(29.98e12, rel=1e-3)
    assert radar.chirp_period_s == pytest.approx(160e-6)
    assert (radar.num_chirps, radar.num_samples) == (64, 256)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("API:ProfileConfig", "API:X", "no ProfileConfig: is it"),
        ("AR1843", "AR9999", "chip AR9999, expected one of"),
        ("AdcOutConfig,2,1", "AdcOutConfig,2,0", "real samples were recorded"),
        ("0,0,0,1,0,0,", "0,0,0,1,1,0,", "expected each chirp to fire one"),
        ("FrameConfig,0,2", "FrameConfig,0,3", "incomplete configuration"),
    ],
)
def test_unusable_studio_log_is_refused(tmp_path, old, new, message):
    path = tmp_path / "log.txt"
    path.write_text(LOG.replace(old, new, 1))
    with pytest.raises(ValueError, match=message):
        radar_from_studio_log(path)


def test_real_studio_log(samples):
    radar = radar_from_studio_log(samples / "dca1000" / "LogFile_0.txt")
    assert radar.cube_shape == (1, 4, 1, 256)
    assert radar.range_resolution_m == pytest.approx(0.1953, abs=1e-4)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"slope_hz_per_s": 1e-320}, "slope_hz_per_s = 1e-320, expected 1e.08"),
        (
            {"start_frequency_hz": 77.0},
            "start_frequency_hz = 77.0, expected 1e.08 .*unit",
        ),
        ({"num_samples": 60_000_000}, "num_samples = 60000000, expected 1 to 65536"),
        ({"tx_positions": [[100_000_000, 0]]}, r"contains \(100000000, 0\), expected"),
        ({"rx_positions": [[0, 0]] * 257}, "257 rx_positions, expected 1 to 256"),
        ({"num_samples": 10**400}, "num_samples = 1000.*, expected 1 to 65536"),
        ({"idle_time_s": 10**400}, "idle_time_s = 1000.*, which is too large"),
        ({"tx_positions": []}, "tx_positions"),
        ({"num_samples": 65536, "num_chirps": 4096}, "samples, expected at most 268,4"),
        ({"ramp_end_time_s": math.nan}, "ramp_end_time_s = nan, expected more than 0"),
    ],
)
def test_numbers_that_no_radar_has(changes, message):
    with pytest.raises(ValueError, match=message):
        RadarSpec.awr1843(**changes)
