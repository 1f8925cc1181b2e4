"""A radar's TOML file: what is written is read back, and wrong values are named."""

import dataclasses
import itertools
import json
from pathlib import Path

import numpy as np
import pytest

from jradar import recordings
from jradar.errors import UsageError
from jradar.radar import Radar, RadarSpec, calibrate
from jradar.recordings import open_recording, read_description, write_radar_toml
from tests.recordings.coloradar_writer import write
from tests.recordings.cube_writer import random_cube, save

README = Path(recordings.__file__).parent / "README.md"
RADAR = RadarSpec.awr1843(num_chirps=8, num_samples=16, frame_period_s=0.1)
WAVEFORM = """start_frequency_hz = 60e9\nslope_hz_per_s = 60e12
sample_rate_hz = 5e6\nnum_samples = 64\nnum_chirps = 8\nidle_time_s = 1e-4
adc_start_time_s = 6e-6\nramp_end_time_s = 40e-6\n"""
FACTORS = np.geomspace(0.5, 2, 12) * np.exp(1j * np.linspace(-3, 3, 12))


@pytest.mark.parametrize("radar", [RADAR, RadarSpec.cascade()], ids=lambda r: r.name)
def test_what_is_written_is_read_back(tmp_path, radar):
    factors = np.resize(FACTORS, radar.num_virtual)
    unit = Radar(radar, range_bias_m=0.0659).with_factors(factors)
    path = tmp_path / "radar.toml"
    write_radar_toml(path, unit, iq_order="Q4I4", comment="of a test\nrig")
    found = read_description(path)
    assert found.radar == radar
    assert (found.capture.iq_order, found.capture.range_bias_m) == ("Q4I4", 0.0659)
    np.testing.assert_allclose(found.capture.channel_factors, factors, rtol=1e-4)
    assert not found.notes


@pytest.mark.parametrize(
    ("name", "found"),
    [
        *((n, n) for n in ("Fahrzeug 📡", "a\x07b\x7fc\x9b", 'quote " and \\')),
        *((n, n) for n in ("two\nlines\t", "\u2028")),
        ("\udcff", "?"),  # a folder's name that is no text
    ],
)
def test_any_name_of_a_radar_is_read_back(tmp_path, name, found):
    path = tmp_path / "radar.toml"
    radar = dataclasses.replace(RADAR, name=name)
    write_radar_toml(path, Radar(radar), comment=f"of {found}")
    assert read_description(path).radar == dataclasses.replace(RADAR, name=found)


def test_the_factors_of_a_file_are_applied_to_the_cube(tmp_path):
    cube = random_cube((3, 2, 4, 4, 8))
    path = save(tmp_path, cube, ["frame", "tx", "rx", "chirp", "sample"])
    before = open_recording(path)
    unit = Radar(before.radar.spec, range_bias_m=0.07).with_factors(FACTORS[:8])
    description = tmp_path / "other" / "calibrated.toml"
    write_radar_toml(description, unit, axes=before.axes)
    after = open_recording(path, description)
    assert after.radar.spec == unit.spec and after.radar.range_bias_m == 0.07
    expected = cube[1] * np.reshape(FACTORS[:8], (2, 4, 1, 1))
    found = calibrate(after.cube(1), after.radar)
    np.testing.assert_allclose(found, expected, rtol=1e-3)


@pytest.mark.parametrize(
    ("device", "tables", "factors"),
    [
        ("iwr6843ods", "", (1, -1, -1, 1) * 3),
        ("iwr6843isk", "", (1,) * 12),
        ("iwr6843ods", "rx_positions = [[0, 0]]", ()),  # which of its receivers?
        ("iwr6843ods", f"[calibration]\ngain_db = {[0] * 12}", (1,) * 12),
    ],
)
def test_the_signs_of_receivers_unless_measured(tmp_path, device, tables, factors):
    text = f'[radar]\ndevice = "{device}"\n{WAVEFORM}{tables}\n'
    found = read_description(write(tmp_path / "radar.toml", text))
    assert found.capture.channel_factors == factors


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ("[calibration]\ngain_db = [1, 2]", "gain_db = .*expected 12 numbers"),
        ("[calibration]\nphase_degrees = 3", "phase_degrees = 3, expected 12"),
        (f"[calibration]\ngain_db = {['a'] * 12}", "expected 12 numbers"),
        (f"[calibration]\ngain_db = [{'nan,' * 12}]", "expected 12 numbers"),
        (f"[calibration]\ngain_db = {[99] * 12}", "at most 60"),
        ("[calibration]\nrange_bias_m = 'far'", "range_bias_m = 'far'"),
        ("[calibration]\nrange_bias_m = nan", "range_bias_m = nan"),
        ("[calibration]\nrange_bias_m = 66", "within the radar's"),
        ("[calibration]\nphases = []", "unknown key of .calibration. 'phases'"),
        ("[file]\niq_order = 'QI'", "iq_order = 'QI', expected one of"),
        ("[file]\nlanes = 3", "lanes = 3, expected 1, 2 or 4 LVDS lanes"),
        ("[file]\nlanes = true", "lanes = True, expected 1, 2 or 4 LVDS lanes"),
        ("[file]\naxis = []", "unknown key of .file. 'axis', expected axes"),
    ],
)
def test_wrong_values_are_named(tmp_path, tables, message):
    text = f'[radar]\ndevice = "awr1843"\n\n{tables}\n'
    with pytest.raises(UsageError, match=message):
        read_description(write(tmp_path / "radar.toml", text))


def test_the_page_lists_every_field_with_its_default():
    lines = README.read_text().splitlines()
    start = lines.index("| field | meaning and unit | `awr1843` |") + 2
    rows = {}
    for line in itertools.takewhile(str.strip, lines[start:]):
        name, meaning, default = (cell.strip() for cell in line.strip("|").split("|"))
        rows[name.strip("`")] = meaning, default
    radar = RadarSpec.awr1843()
    expected = {"upside_down": "false"}
    for field in dataclasses.fields(RadarSpec):
        value = getattr(radar, field.name)
        if isinstance(value, tuple | bool):
            expected[field.name] = json.dumps(value)
        else:
            expected[field.name] = value if field.name == "name" else f"{value:g}"
        optional = field.default is not dataclasses.MISSING or field.name == "name"
        assert ("optional" in rows[field.name][0]) == optional, field.name
    rows.pop("device")
    assert {name: default for name, (_, default) in rows.items()} == expected
    assert list(rows) == list(expected)
