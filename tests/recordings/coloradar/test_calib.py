"""ColoRadar's calibration folders: known radars, repaired times, arrays, clear errors.

Files are written here value by value, without the readers' help.
"""

import numpy as np
import pytest

from jradar.radar import RadarSpec
from jradar.recordings import read_coupling
from jradar.recordings.coloradar.calib import radar_from_coloradar, read_frequency_phase
from tests.recordings import coloradar_writer as files


@pytest.fixture
def write(tmp_path):
    """A function that writes a folder, with replacements, and returns its path."""

    def write(*replacements):
        texts = [files.waveform(), f"# half wavelengths\n\n{files.ANTENNAS}"]
        for old, new in replacements:
            assert old in "".join(texts)
            texts = [text.replace(old, new) for text in texts]
        for name, text in zip(("waveform", "antenna"), texts, strict=True):
            (tmp_path / f"{name}_cfg.txt").write_text(text)
        return tmp_path

    return write


def assert_same_radar(radar, other):
    for field in ("cube_shape", "tx_positions", "rx_positions", "tx_firing_order"):
        assert getattr(radar, field) == getattr(other, field)
    for field in ("range_resolution_m", "max_velocity_mps", "spacing_wavelengths"):
        assert getattr(radar, field) == pytest.approx(getattr(other, field), rel=1e-6)


@pytest.mark.filterwarnings("error")
def test_fields_are_in_si_units(write):
    radar = radar_from_coloradar(write(("tx 1 2 1", "tx 1 2 1   # the last")))
    assert radar.cube_shape == (2, 2, 4, 8)
    assert radar.tx_positions == ((0, 0), (2, 1))
    assert radar.rx_positions == ((0, 0), (1, 0))
    assert (radar.sample_rate_hz, radar.idle_time_s) == (10666000.0, 110e-6)
    assert radar.start_frequency_hz == 76999999488.0
    assert radar.slope_hz_per_s == 1.00000000377e14
    assert radar.adc_start_time_s == 7.00000009601e-06
    assert radar.ramp_end_time_s == 1.99999994948e-05
    assert (radar.design_frequency_hz, radar.frame_period_s) == (76.8e9, 0)
    assert radar.tx_firing_order == (0, 1)
    folder = write(("tx 0 0 0\ntx 1 2 1", "tx 1 2 1\ntx 0 0 0"))
    assert radar_from_coloradar(folder) == radar


def test_times_as_they_are_shipped_are_repaired_with_warnings(write):
    folder = write(("7.00000009601e-06", "5.0"), ("1.99999994948e-05", "4e-11"))
    with pytest.warns(UserWarning) as warned:
        radar = radar_from_coloradar(folder)
    assert ["adc_start_time = 5 s", "ramp_end_time = 4e-11 s"] == [
        str(w.message).split(": ")[1].split(" is impossible")[0] for w in warned
    ]
    assert radar.adc_start_time_s == pytest.approx(5e-6)
    assert radar.ramp_end_time_s == pytest.approx(40e-6)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("F_design", "num_rx 5\nF_design", "rx antennas .* expected each of 0 to 4 o"),
        ("F_design", "num_rx 300000000\nF_design", "rx antennas .0, 1., expected each"),
        ("num_tx 2", "num_tx 3", "places 2 tx antennas, .*_cfg.txt has num_tx = 3"),
        ("frequency_slope", "slope", "no frequency_slope"),
        ("chirp 8", "chirp 8.5", "num_adc_samples_per_chirp = 8.5, expected a whole"),
        ("idle_time", "idle_time 3", "line 7: 'idle_time 3 0.00011', expected 'key"),
        ("0.00011", "soon", "could not convert .*, expected numbers"),
        ("0.00011", "nan", "expected a list of finite numbers"),
        ("chirp 8", "chirp 256", "sampling ends 31.00 us into the chirp"),
        ("tx 1 2 1", "tx 3 2 1", r"tx antennas \[0, 3\], expected each of 0 to 1 once"),
        ("tx 1 2 1", "tx 1 2.5 1", "expected whole half wavelengths"),
        ("tx 1 2 1", "tx 1 2", "line 7: 'tx 1 2', expected 'tx index azimuth"),
        ("F_design 76.8", "", "no F_design, the design frequency in GHz"),
    ],
)
def test_unusable_folder_is_refused(write, tmp_path, old, new, message):
    with pytest.raises(ValueError, match="expected a folder such as calib/single_chip"):
        radar_from_coloradar(tmp_path)
    with pytest.raises(ValueError, match=message):
        radar_from_coloradar(write((old, new)))


COUPLING = np.arange(24).reshape(2, 3, 4) * (1 - 2.5j) + 7
COUPLED = files.coupling_text(COUPLING)


@pytest.mark.parametrize(
    "text", [COUPLED, "\n# rebuilt\n" + COUPLED.replace(",", ",\n ")]
)
def test_coupling_is_complex_by_tx_rx_and_range(tmp_path, text):
    path = files.write(tmp_path / "coupling_calib.txt", text)
    np.testing.assert_array_equal(read_coupling(path), COUPLING)


RADAR = RadarSpec.awr1843()
FREQUENCIES = np.array([[30.5, 31, 32], [33, 34, 35]])
PHASES = np.array([[1 + 2j, 3 + 4j, 5 + 6j], [7 + 8j, 9 + 10j, 11 + 12j]])


def test_frequency_and_phase_lie_by_tx_and_rx(tmp_path):
    path = files.write(tmp_path / "calib.txt", files.phases_text(FREQUENCIES, PHASES))
    channels, bins = read_frequency_phase(path, RADAR)
    scale = RADAR.slope_hz_per_s / 79e12 * 8e6 / RADAR.sample_rate_hz
    np.testing.assert_allclose(bins, (FREQUENCIES - 30.5) * scale, rtol=1e-6)
    np.testing.assert_allclose(channels, (1 + 2j) / PHASES, rtol=1e-6)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (COUPLED[:-20], "holds 4[0-9] numbers, 2 tx x 3 rx x 4 comp"),
        (files.coupling_text(COUPLING, num_range_bins=8), "complex range bins need 96"),
        (COUPLED.replace("num_rx", "rx"), "no num_rx, expected lines"),
        (files.coupling_text(COUPLING, num_tx=0), "num_tx = 0, expected a whole numbe"),
        (COUPLED.replace("7.0", "x", 1), "expected numbers"),
        (COUPLED.replace("7.0", "inf", 1), "finite numbers"),
        ({"numRx": 4}, "6 frequencies and 12 parts of phases, 2 tx x 4 rx need 8"),
        ({"numTx": None}, "expected a list of finite numbers"),
        ({"samplingRate": 0}, "samplingRate = 0.0, expected positive"),
        ({"frequencySlope": "steep"}, "expected numbers"),
        ({"frequencySlope": 79.0}, "slopes in Hz/s differ by a factor of 1.27e"),
        ({"phaseCalibrationMatrix": [0] * 12}, "a phase is 0"),
        ({"phaseCalibrationMatrix": {"re": 1}}, "TypeError.*, expected antennaCalib"),
        ("{", "damaged or not a JSON file"),
        ("{}", "KeyError.*, expected antennaCalib with"),
        ("[]", "is a list, expected an object"),
    ],
)
def test_unusable_coupling_frequency_and_phase_are_refused(tmp_path, content, message):
    if isinstance(content, dict):  # what differs from the file above
        content = files.phases_text(FREQUENCIES, PHASES, **content)
    path = files.write(tmp_path / "calib.txt", content)
    with pytest.raises(ValueError, match=message):
        if "num_" in content:
            read_coupling(path)
        else:
            read_frequency_phase(path, RADAR)


def test_real_values_of_the_data_set(samples):
    calib = samples / "coloradar_calib_reconstructed"
    for name, radar in (("single_chip", RADAR), ("cascade", RadarSpec.cascade())):
        assert_same_radar(radar_from_coloradar(calib / name), radar)
    coupling = read_coupling(calib / "single_chip" / "coupling_calib.txt")
    assert coupling.shape == (3, 4, 64)
    assert abs(coupling[0, 0, 0]) == pytest.approx(12_750, abs=1)
    assert not coupling[2].any()
