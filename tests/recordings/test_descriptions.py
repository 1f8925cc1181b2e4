"""Which file beside a capture describes it; radars in .mmwave.json files."""

import copy
import functools
import json
import math
import operator

import pytest

from jradar.errors import UsageError
from jradar.recordings import open_recording, read_description
from tests.recordings.coloradar_writer import write
from tests.recordings.cube_writer import LOG, RADAR, SHAPE, random_cube, save_studio

CARD_LOG = """\
DCA1000EVM CLI Record process version : 1.0
Capture start time - Fri Nov 20 10:00:00 2026
Out of sequence count - 0
"""
CARD = json.dumps({"DCA1000Config": {"dataLoggingMode": "raw", "lvdsMode": 2}})
VARIATIONS = ("startFreqVar_MHz", "freqSlopeVar_KHz_usec")
VARIATIONS += ("idleTimeVar_usec", "adcStartTimeVar_usec")


def chirp(number, mask, **changes):
    fields = {"chirpStartIdx": number, "chirpEndIdx": number, "profileId": 0}
    fields |= dict.fromkeys(VARIATIONS, 0.0) | {"txEnable": mask}
    return {"rlChirpCfg_t": fields | changes}


STUDIO = json.loads("""
{"mmWaveDevices": [{"mmWaveDeviceId": 0,
  "rfConfig": {"waveformType": "legacyFrameChirp",
    "rlChanCfg_t": {"rxChannelEn": "0xF", "txChannelEn": "0x7"},
    "rlAdcOutCfg_t": {"fmt": {"b2AdcBits": 2, "b2AdcOutFmt": 1}},
    "rlProfiles": [{"rlProfileCfg_t": {"profileId": 0, "startFreqConst_GHz": 77.0,
      "idleTimeConst_usec": 100.0, "adcStartTimeConst_usec": 6.0,
      "rampEndTime_usec": 60.0, "freqSlopeConst_MHz_usec": 29.982,
      "numAdcSamples": 8, "digOutSampleRate": 10000.0}}],
    "rlFrameCfg_t": {"chirpStartIdx": 0, "chirpEndIdx": 2, "numLoops": 4,
      "framePeriodicity_msec": 40.0}},
  "rawDataCaptureConfig": {
    "rlDevDataFmtCfg_t": {"iqSwapSel": 0, "chInterleave": 1}}}]}
""")
IN_TURN = [chirp(number, mask) for number, mask in enumerate(("0x1", "0x4", "0x2"))]
STUDIO["mmWaveDevices"][0]["rfConfig"]["rlChirps"] = IN_TURN


@pytest.fixture
def capture(tmp_path):
    """A capture of mmWave Studio with its log."""
    return save_studio(tmp_path, random_cube((2, *SHAPE)))


def test_other_files_beside_a_capture_describe_nothing(capture, tmp_path):
    for name, text in {
        "CLI_LogFile.txt": CARD_LOG,
        "adc_data_Raw_LogFile.csv": CARD_LOG,
        "cf.json": CARD,
        "sensor_start.cfg": "sensorStart\n",
        "notes.toml": "[place]\nname = 'hall'\n",
        "capture.toml": '[radar]\nfile = "adc_data.bin"\ndescription = "other.cfg"\n',
    }.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "folder.cfg").mkdir()
    assert open_recording(capture).radar.spec.num_chirps == 4


@pytest.mark.parametrize(
    ("name", "others", "taken"),
    [
        ("adc_data_1.bin", ["LogFile_0.txt", "LogFile_1.txt"], 1),
        ("adc_data_1.bin", ["LogFile_1.txt", "LogFile_11.txt", "LogFile_01_b.txt"], 0),
        ("adc_data_2.bin", ["adc_data_2_LogFile.txt", "LogFile_2.txt"], 0),
        ("adc_data.bin", ["adc_data_1_LogFile.txt", "adc_data_LogFile.txt"], 1),
        ("run7_Raw_0.bin", ["LogFile_0.txt", "run7_LogFile.txt"], 1),
        ("run.bin", ["other.cfg", "run.toml"], 1),
    ],
)
def test_a_capture_takes_the_file_of_its_name(capture, tmp_path, name, others, taken):
    (tmp_path / "adc_LogFile.txt").unlink()
    path = capture.rename(tmp_path / name)
    for number, other in enumerate(others):
        text = RADAR if other.endswith(".toml") else LOG
        text = text.replace("3,4,200000", f"3,{4 if number == taken else 5},200000")
        text = "profileCfg" if other.endswith(".cfg") else text
        (tmp_path / other).write_text(text)
    assert open_recording(path).radar.spec.num_chirps == 4


def test_several_descriptions_are_listed(capture, tmp_path):
    (tmp_path / "LogFile_0.txt").write_text(LOG)
    with pytest.raises(UsageError, match=r"2 radar .* \(LogFile_0.txt, adc_LogFile"):
        open_recording(capture)
    path = capture.rename(tmp_path / "adc_data_7.bin")
    with pytest.raises(UsageError, match="2 radar descriptions .* --radar"):
        open_recording(path)


def changed(*keys, to):
    """The file with the value behind `keys` replaced, or removed by `...`."""
    values = copy.deepcopy(STUDIO)
    *path, last = ("mmWaveDevices", *keys)
    inner = functools.reduce(operator.getitem, path, values)
    inner[last] = to
    if to is ...:
        del inner[last]
    return values


def studio(folder, values=STUDIO):
    return write(folder / "run.mmwave.json", json.dumps(values))


RADIO = (0, "rfConfig")
STREAM = (0, "rawDataCaptureConfig", "rlDevDataFmtCfg_t")


def test_radar_in_a_json_of_mmwave_studio(tmp_path):
    radar, capture, notes = read_description(studio(tmp_path))
    assert radar.cube_shape == (3, 4, 4, 8) and notes == ()
    assert radar.tx_positions == ((0, 0), (4, 0), (2, 1))  # masks 1, 4, 2
    assert radar.start_frequency_hz == 77e9 and radar.sample_rate_hz == 10e6
    assert radar.slope_hz_per_s == pytest.approx(29.982e12)
    assert radar.chirp_period_s == pytest.approx(160e-6)
    assert radar.frame_period_s == pytest.approx(0.04)
    assert capture.iq_order == "IIQQ" and not {*capture.channel_factors} - {1}
    for field, value, order in (("iqSwapSel", 1, "QQII"), ("chInterleave", 0, "I4Q4")):
        path = studio(tmp_path, changed(*STREAM, field, to=value))
        assert read_description(path).capture.iq_order == order
    three = studio(tmp_path, changed(*RADIO, "rlChanCfg_t", "rxChannelEn", to="0xD"))
    assert read_description(three).radar.rx_positions == ((0, 0), (2, 0), (3, 0))


def test_a_json_beside_its_capture(capture, tmp_path):
    (tmp_path / "adc_LogFile.txt").unlink()
    two = changed(*RADIO, "rlChirps", to=[chirp(0, "0x1"), chirp(1, "0x4")])
    two["mmWaveDevices"][0]["rfConfig"]["rlFrameCfg_t"]["chirpEndIdx"] = 1
    studio(tmp_path, two)
    write(tmp_path / "cf.json", CARD)
    assert open_recording(capture).radar.spec.cube_shape == SHAPE


def test_the_card_is_no_radar(tmp_path, samples):
    real = samples / "cfg" / "EsonJohn__dca1000_cf.json"
    for path in (write(tmp_path / "cf.json", CARD), real):
        with pytest.raises(UsageError, match=f"{path} describes the capture card"):
            read_description(path)


@pytest.mark.parametrize(
    ("keys", "to", "message"),
    [
        ((), [], "0 mmWaveDevices"),
        ((), {"rfConfig": {}}, "no mmWaveDevices"),
        ((), [{}] * 4, "4 mmWaveDevices, expected a list of one"),
        ((0,), 3, "mmWaveDevices holds 3"),
        ((0, "rfConfig"), ..., "rfConfig = None, expected a dict"),
        ((*RADIO, "rlFrameCfg_t"), ..., "rlFrameCfg_t = None, expected a dict"),
        ((*RADIO, "rlFrameCfg_t"), [1], r"rlFrameCfg_t = \[1\], expected a dict"),
        ((*RADIO, "rlFrameCfg_t", "numLoops"), True, "numLoops = True"),
        ((*RADIO, "rlFrameCfg_t", "numLoops"), math.nan, "numLoops = nan"),
        ((*RADIO, "rlFrameCfg_t", "numLoops"), 10**400, "at most 1e"),
        *(
            ((*RADIO, "rlChirps", 1), chirp(1, "4", **{name: 1}), "differ in profile")
            for name in ("profileId", *VARIATIONS)
        ),
        ((*RADIO, "rlChirps", 1), {}, "rlChirps rlChirpCfg_t = None"),
        ((*RADIO, "rlChirps", 1), chirp(1, "0xZ"), "'0xZ', expected a mask"),
        ((*RADIO, "rlChirps", 1), chirp(1, "F" * 10**5), "a mask = .*a whole number"),
        ((*RADIO, "rlChirps", 1), chirp(1, 4), "txEnable = 4, expected a str"),
        ((*RADIO, "rlChanCfg_t", "txChannelEn"), "0x1", "are enabled, the frame needs"),
        ((*RADIO, "rlAdcOutCfg_t", "fmt", "b2AdcBits"), 0, "expected 2"),
        ((*RADIO, "rlAdcOutCfg_t", "fmt", "b2AdcOutFmt"), 0, "complex samples"),
        ((*STREAM, "iqSwapSel"), ..., "iqSwapSel = None"),
    ],
    ids=lambda value: str(value)[:30],
)
def test_unusable_json_is_named(tmp_path, keys, to, message):
    path = studio(tmp_path, changed(*keys, to=to))
    with pytest.raises(ValueError, match=f"run.mmwave.json.*({message})"):
        read_description(path)


@pytest.mark.parametrize("text", ["", "[]", "{", "[" * 100_000, "3", '{"a": 1}'])
def test_other_json_is_refused(tmp_path, text):
    with pytest.raises(ValueError, match="run.json"):
        read_description(write(tmp_path / "run.json", text))
