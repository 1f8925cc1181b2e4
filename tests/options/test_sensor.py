"""RadarSpec: derived quantities against published ones, files, and clear errors."""

import dataclasses
import math

import numpy as np
import pytest

from jradar.radar import RadarSpec
from jradar.recordings import read_description
from tests.radar.targets import CASCADE, plane_wave
from tests.recordings.coloradar_writer import write

TOML = '[radar]\ndevice = "awr1642"\nnum_chirps = 64\ntx_positions = [[0, 0], [4, 0]]\n'
SIMPLE = {"start_frequency_hz": 24.0e9, "bandwidth_hz": 250e6, "chirp_s": 0.5e-3}
SIMPLE |= {"num_samples": 256, "num_chirps": 32}


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


def test_firing_position_inverts_the_firing_order():
    assert tuple(np.argsort(CASCADE.firing_position)) == CASCADE.tx_firing_order
    assert CASCADE.firing_position[3] == 9  # the first elevated one fires tenth


def test_upside_down_right_is_left_and_up_is_down():
    turned = RadarSpec.from_dict({"device": "awr1843", "upside_down": True})
    assert turned == RadarSpec.awr1843().upside_down() != RadarSpec.awr1843()
    assert turned.upside_down() == RadarSpec.awr1843()
    wave = plane_wave(turned, 0.4, -0.2)
    other_way = plane_wave(RadarSpec.awr1843(), -0.4, 0.2)
    np.testing.assert_allclose(wave / wave[0], other_way / other_way[0])


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
    other = dataclasses.replace(RadarSpec.named("awr1443", **waveform), name="awr1843")
    assert RadarSpec.named("awr1843", tx_positions=in_mask_order) == other


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"device": "awr1834"}, r"device = 'awr1834', .*: did you mean 'awr1843'\?"),
        ({"device": "awr1443"}, "missing radar fields: start_frequency_hz"),
        ({"num_chirp": 3}, "'num_chirp', expected num_chirps"),
        ({"num_chirps": 1.5}, "num_chirps = 1.5, expected an int"),
        ({"num_chirps": 0}, "num_chirps = 0, expected more than 0"),
        ({"idle_time_s": -1}, "idle_time_s = -1.0, expected 0 or"),
        ({"slope_hz_per_s": math.nan}, "slope_hz_per_s = nan"),
        ({"slope_hz_per_s": 1e-320}, "slope_hz_per_s = 1e-320, expected 1e.08"),
        ({"start_frequency_hz": 77.0}, "_hz = 77.0, expected 1e.08 .*unit"),
        ({"ramp_end_time_s": 13e-6}, "after ramp_end_time_s"),
        ({"ramp_end_time_s": math.nan}, "ramp_end_time_s = nan, expected a number"),
        ({"num_samples": 60_000_000}, "num_samples = 60000000, expected 1 to 65536"),
        ({"num_samples": 10**400}, "num_samples = 1000.*, expected 1 to 65536"),
        ({"num_samples": 65536, "num_chirps": 4096}, "samples, expected at most 268,4"),
        ({"idle_time_s": 10**400}, "idle_time_s = 1000.*, expected a number"),
        ({"tx_positions": [[0, 0.5]]}, "expected a list of lists of 2 integers"),
        ({"tx_positions": 3}, "tx_positions = 3, expected a list"),
        ({"tx_positions": []}, "tx_positions"),
        ({"tx_positions": [[100_000_000, 0]]}, r"contains \(100000000, 0\), expected"),
        ({"rx_positions": [[0, 0]] * 257}, "257 rx_positions, expected 1 to 256"),
        ({"tx_firing_order": [0, 1]}, "each of the 3 transmitters"),
    ],
)
def test_impossible_radar_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        RadarSpec.from_dict({"device": "awr1843"} | changes)


def test_toml_names_a_device_and_changes_it(tmp_path):
    found = read_description(write(tmp_path / "radar.toml", TOML))
    assert found.radar == RadarSpec.awr1642(num_chirps=64)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (TOML + "slope = 3", "unknown field 'slope'"),
        ("[radar", "not a TOML file"),
        (b"\xff\xfe\x00", "not a text file"),
        ("[radar]\ndevice = []", "device = .*, expected a text"),
        ("[radar]\ndevice = true", "device = .*, expected a text"),
        ("radar = 3", "radar = .*, expected a table"),
        ("[[radar]]\nname = 'a'", "radar = .*, expected a table"),
    ],
)
def test_toml_that_describes_no_radar_is_refused(tmp_path, content, message):
    with pytest.raises(ValueError, match=f"radar.toml.*{message}"):
        read_description(write(tmp_path / "radar.toml", content))


def test_real_studio_log(samples):
    radar = read_description(samples / "dca1000" / "LogFile_0.txt").radar
    assert radar.cube_shape == (1, 4, 1, 256)
    assert radar.range_resolution_m == pytest.approx(0.1953, abs=1e-4)


def test_a_simple_radar_has_the_textbooks_resolutions():
    """A 24 GHz board: 250 MHz in 0.5 ms, four receivers, one transmitter."""
    radar = RadarSpec.simple(**SIMPLE, num_rx=4, period_s=1e-3, name="24 GHz")
    assert radar.range_resolution_m == pytest.approx(299_792_458 / (2 * 250e6))
    assert radar.max_velocity_mps == pytest.approx(299_792_458 / 24.125e9 / 4e-3)
    assert radar.spacing_wavelengths == pytest.approx(0.5)
    assert (radar.name, radar.cube_shape) == ("24 GHz", (1, 4, 32, 256))
    with pytest.raises(ValueError, match="idle_time_s = -0.0004"):
        RadarSpec.simple(**SIMPLE, period_s=1e-4)


def test_times_of_a_board_are_named_as_such():
    """A longer chirp, whose end is still that of the device."""
    with pytest.raises(
        ValueError, match="sampling ends 32.00 us .* Not described, and"
    ) as e:
        RadarSpec.named("awr1843", num_samples=256, sample_rate_hz=10.24e6)
    assert str(e.value).endswith(
        "taken from the awr1843: adc_start_time_s, ramp_end_time_s"
    )
    with pytest.raises(ValueError, match="in seconds.$"):
        RadarSpec.named(
            "awr1843",
            **{"num_samples": 256, "sample_rate_hz": 10.24e6, "ramp_end_time_s": 2e-5},
            adc_start_time_s=7e-6,
        )
    with pytest.raises(ValueError, match="unit.$"):
        RadarSpec.named("awr1843", num_samples=1 << 20)
