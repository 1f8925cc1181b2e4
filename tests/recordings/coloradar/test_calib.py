"""ColoRadar's calibration folders: known radars, repaired times, arrays, clear errors.

Files are written here value by value, without the readers' help.
"""

import json

import numpy as np
import pytest

from jradar.radar import RadarSpec
from jradar.recordings import radar_from_coloradar, read_coupling, read_frequency_phase

WAVEFORM = """\
num_rx 4
num_tx 3
num_adc_samples_per_chirp 128
num_chirps_per_frame 128
adc_sample_frequency 10666000.0
start_frequency 76999999488.0
idle_time 0.00011
adc_start_time 7.00000009601e-06
ramp_end_time 1.99999994948e-05
frequency_slope 1.00000000377e+14
"""
ANTENNAS = """\
# half wavelengths
num_rx 4
num_tx 3
F_design 76.8

rx 0 0 0
rx 1 1 0
rx 2 2 0
rx 3 3 0   # the last
tx 0 0 0
tx 2 2 1
tx 1 4 0
"""
CASCADE_TX = [0, 4, 8, 9, 10, 11, 12, 16, 20, 24, 28, 32]
CASCADE_ELEVATION = {9: 1, 10: 4, 11: 6}
CASCADE_RX = [0, 1, 2, 3, 11, 12, 13, 14, 46, 47, 48, 49, 50, 51, 52, 53]


@pytest.fixture
def write(tmp_path):
    """A function that writes a folder, with one replacement, and returns its path."""

    def write(old="", new="", waveform=WAVEFORM, antennas=ANTENNAS):
        assert old in waveform + antennas
        (tmp_path / "waveform_cfg.txt").write_text(waveform.replace(old, new))
        (tmp_path / "antenna_cfg.txt").write_text(antennas.replace(old, new))
        return tmp_path

    return write


@pytest.fixture
def cascade(write):
    """A function that writes the cascade's folder with the times that are shipped."""

    def cascade(adc_start="5.0", ramp_end="4e-11"):
        waveform = (
            "num_rx 16\nnum_tx 12\nnum_adc_samples_per_chirp 256\n"
            "num_chirps_per_frame 16\nadc_sample_frequency 8000000.0\n"
            "start_frequency 76999999488.0\nidle_time 5e-06\n"
            f"adc_start_time {adc_start}\nramp_end_time {ramp_end}\n"
            "frequency_slope 79000001052672.0\n"
        )
        tx = [(a, CASCADE_ELEVATION.get(a, 0)) for a in CASCADE_TX]
        rows = [f"tx {i} {a} {e}" for i, (a, e) in enumerate(tx)]
        rows += [f"rx {i} {a} 0" for i, a in enumerate(CASCADE_RX)]
        return write(waveform=waveform, antennas="\n".join(["F_design 76.8", *rows]))

    return cascade


def test_a_claimed_number_of_antennas_takes_no_memory(write):
    with pytest.raises(ValueError, match="rx antennas .0, 1, 2, 3., expected each of"):
        radar_from_coloradar(write("num_rx 4", "num_rx 300000000"))


def assert_same_radar(radar, other):
    assert radar.cube_shape == other.cube_shape
    assert radar.tx_positions == other.tx_positions
    assert radar.rx_positions == other.rx_positions
    assert radar.tx_firing_order == other.tx_firing_order
    for field in ("range_resolution_m", "max_velocity_mps", "spacing_wavelengths"):
        assert getattr(radar, field) == pytest.approx(getattr(other, field), rel=1e-6)


def test_single_chip_is_the_awr1843(write):
    radar = radar_from_coloradar(write())
    assert_same_radar(radar, RadarSpec.awr1843())
    assert radar.frame_period_s == 0


def test_cascade_times_are_repaired_with_warnings(cascade):
    with pytest.warns(UserWarning) as warned:
        radar = radar_from_coloradar(cascade())
    assert ["adc_start_time = 5 s", "ramp_end_time = 4e-11 s"] == [
        str(w.message).split(": ")[1].split(" is impossible")[0] for w in warned
    ]
    assert_same_radar(radar, RadarSpec.cascade())
    assert radar.adc_start_time_s == pytest.approx(5e-6)
    assert radar.ramp_end_time_s == pytest.approx(40e-6)


@pytest.mark.filterwarnings("error")
def test_sane_times_are_left_alone(cascade, write):
    folder = cascade("5e-06", "4e-05")
    assert_same_radar(radar_from_coloradar(folder), RadarSpec.cascade())


@pytest.mark.filterwarnings("error")
def test_firing_order_may_be_given(cascade):
    order = tuple(range(12))
    folder = cascade("5e-06", "4e-05")
    radar = radar_from_coloradar(folder, tx_firing_order=order)
    assert radar.tx_firing_order == order


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("num_rx 4\n", "num_rx 5\n", "rx antennas .* expected each of 0 to 4 once"),
        ("num_tx 3\nnum_adc", "num_tx 2\nnum_adc", "places 3 tx antennas, waveform"),
        ("frequency_slope", "slope", "no frequency_slope"),
        ("128", "128.5", "num_adc_samples_per_chirp = 128.5, expected a whole"),
        ("idle_time", "idle_time 3", "line 7: 'idle_time 3 0.00011', expected 'key"),
        ("0.00011", "soon", "could not convert .*, expected numbers"),
        ("0.00011", "nan", "expected a list of finite numbers"),
        ("chirp 128", "chirp 256", "sampling ends 31.00 us into the chirp"),
        ("tx 2", "tx 3", r"tx antennas \[0, 1, 3\], expected each of 0 to 2 once"),
        ("tx 2 2 1", "tx 2 2.5 1", "expected whole half wavelengths"),
        ("tx 2 2 1", "tx 2 2", "line 11: 'tx 2 2', expected 'tx index azimuth"),
        ("F_design 76.8", "", "no F_design, the design frequency in GHz"),
    ],
)
def test_unusable_folder_is_refused(write, old, new, message):
    with pytest.raises(ValueError, match=message):
        radar_from_coloradar(write(old, new))


def test_another_folder_is_refused(tmp_path):
    with pytest.raises(ValueError, match="expected a folder such as calib/single_chip"):
        radar_from_coloradar(tmp_path)


def coupling_text(values, tx=2, rx=3, half=4):
    data = ",".join(f"{v.real},{v.imag}" for v in np.ravel(values))
    return (
        f"num_tx:{tx}\nnum_rx:{rx}\nnum_range_bins:{half}\nnum_doppler_bins:8\n"
        f"data:{data}\n"
    )


COUPLING = np.arange(24).reshape(2, 3, 4) * (1 - 2.5j) + 7


def test_coupling_is_complex_by_tx_rx_and_range(tmp_path):
    path = tmp_path / "coupling_calib.txt"
    path.write_text(coupling_text(COUPLING))
    np.testing.assert_array_equal(read_coupling(path), COUPLING)
    path.write_text("\n# rebuilt\n" + coupling_text(COUPLING).replace(",", ",\n "))
    np.testing.assert_array_equal(read_coupling(path), COUPLING)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            coupling_text(COUPLING)[:-20],
            "holds 4[0-9] numbers, 2 tx x 3 rx x 4 comp",
        ),
        (coupling_text(COUPLING, half=8), "complex range bins need 96"),
        (coupling_text(COUPLING).replace("num_rx", "rx"), "no num_rx, expected lines"),
        (coupling_text(COUPLING, tx=0), "num_tx = 0, expected a whole number above 0"),
        (coupling_text(COUPLING).replace("7.0", "x", 1), "expected numbers"),
        (coupling_text(COUPLING).replace("7.0", "inf", 1), "finite numbers"),
    ],
)
def test_unusable_coupling_is_refused(tmp_path, text, message):
    path = tmp_path / "coupling_calib.txt"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        read_coupling(path)


RADAR = RadarSpec.awr1843()
FREQUENCY_PHASE = {
    "numTx": 2,
    "numRx": 3,
    "frequencySlope": 79e12,
    "samplingRate": 8e6,
    "frequencyCalibrationMatrix": [30.5, 31, 32, 33, 34, 35],
    "phaseCalibrationMatrix": [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12],
}


def test_frequency_and_phase_lie_by_tx_and_rx(tmp_path):
    path = tmp_path / "phase_frequency_calib.txt"
    path.write_text(json.dumps({"antennaCalib": FREQUENCY_PHASE}))
    channels, bins = read_frequency_phase(path, RADAR)
    scale = RADAR.slope_hz_per_s / 79e12 * 8e6 / RADAR.sample_rate_hz
    expected = np.array([[0, 0.5, 1.5], [2.5, 3.5, 4.5]]) * scale
    np.testing.assert_allclose(bins, expected, rtol=1e-6)
    phase = np.array([[1 + 2j, 3 + 4j, 5 + 6j], [7 + 8j, 9 + 10j, 11 + 12j]])
    np.testing.assert_allclose(channels, (1 + 2j) / phase, rtol=1e-6)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"numRx": 4}, "6 frequencies and 12 parts of phases, 2 tx x 4 rx need 8"),
        ({"numTx": None}, "expected a list of finite numbers"),
        ({"samplingRate": 0}, "samplingRate = 0.0, expected positive"),
        ({"frequencySlope": "steep"}, "expected numbers"),
        ({"frequencySlope": 79.0}, "slopes in Hz/s differ by a factor of 1.27e"),
        ({"phaseCalibrationMatrix": [0] * 12}, "a phase is 0"),
        ({"phaseCalibrationMatrix": {"re": 1}}, "TypeError.*, expected antennaCalib"),
    ],
)
def test_unusable_frequency_and_phase_are_refused(tmp_path, changes, message):
    path = tmp_path / "phase_frequency_calib.txt"
    path.write_text(json.dumps({"antennaCalib": FREQUENCY_PHASE | changes}))
    with pytest.raises(ValueError, match=message):
        read_frequency_phase(path, RADAR)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "damaged or not a JSON file"),
        ("{}", "KeyError.*, expected antennaCalib with"),
        ("[]", "is a list, expected an object"),
    ],
)
def test_other_json_is_refused(tmp_path, text, message):
    path = tmp_path / "phase_frequency_calib.txt"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        read_frequency_phase(path, RADAR)


def test_real_values_of_the_data_set(samples):
    calib = samples / "coloradar_calib_reconstructed"
    single = radar_from_coloradar(calib / "single_chip")
    assert_same_radar(single, RadarSpec.awr1843())
    cascade = radar_from_coloradar(calib / "cascade")
    assert_same_radar(cascade, RadarSpec.cascade())
    coupling = read_coupling(calib / "single_chip" / "coupling_calib.txt")
    assert coupling.shape == (3, 4, 64)
    assert abs(coupling[0, 0, 0]) == pytest.approx(12_750, abs=1)
    assert not coupling[2].any()
