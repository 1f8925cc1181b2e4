"""Logs of mmWave Studio: several configurations, malformed lines, claimed sizes."""

import functools

import pytest

from jradar.errors import UsageError
from jradar.recordings import open_recording, read_description
from jradar.recordings.ti.studio_log import read_studio_log
from tests.recordings.coloradar_writer import write
from tests.recordings.cube_writer import LOG, SHAPE, random_cube, save_studio

SECOND = """\
API:ProfileConfig,0,1435384036,10000,600,6000,0,0,500,0,8,10000,0,0,30,0,
API:FrameConfig,0,1,3,7,200000,0,512,0,
API:SensorStart,0,
"""


@pytest.fixture
def log(tmp_path):
    """A function that writes a log: its path."""
    return functools.partial(write, tmp_path / "LogFile.txt")


def chirps(path, configuration=None):
    return read_studio_log(path, configuration=configuration)[0].num_chirps


def test_texts_of_other_kinds_and_unfinished_logs_are_named(log):
    text = "is a text that begins with 'hello, world', not a log of mmWave Studio"
    with pytest.raises(ValueError, match=text):
        read_description(log("hello, world\nand more"))
    unfinished = "".join(line for line in LOG.splitlines(True) if "Frame" not in line)
    with pytest.raises(ValueError, match="is a log .* without FrameConfig: send all"):
        read_description(log(unfinished))


def test_an_unusable_configuration_among_several(log):
    both_fire = LOG.replace("0,0,0,1,0,", "0,0,0,3,0,")
    [note] = read_description(log(both_fire + LOG)).notes
    assert "#1 unusable; #2 2 x 4 x 4 x 8, 6.25 m, 0.001 s); #2 was" in note
    many = "".join(LOG.replace(",3,4,", f",3,{n},") for n in range(1, 9))
    [note] = read_description(log(many)).notes
    assert ": #4 2 x 4 x 4 x 8, 6.25 m, 0.001 s; #5" in note


def test_of_several_configurations_the_last_complete_one_is_taken(log):
    assert chirps(log(LOG + SECOND)) == 7
    assert chirps(log(LOG + SECOND), 1) == 4
    unfinished = "API:ProfileConfig,0,1435384036,10000,600,6000,0,0,9,0,8,10000,0,0,30,"
    radar = read_description(log(LOG + SECOND + unfinished)).radar
    assert radar.num_chirps == 7
    assert radar.slope_hz_per_s == pytest.approx(500 * 48.279e9, rel=1e-4)
    # A profile without a new frame counts when the sensor starts.
    changed = LOG + SECOND.splitlines(keepends=True)[0]
    assert read_description(log(changed)).notes == ()
    started = read_description(log(changed + "API:SensorStart,0,\n")).radar
    assert started.slope_hz_per_s == radar.slope_hz_per_s


def test_transmitters_as_masks(log):
    """As real logs of an AR1642 write them: a mask, and the result 0."""
    masks = LOG.replace("0,0,0,0,0,0,1,\n", "0,0,0,0,0,2,0,\n")
    radar = read_description(log(masks)).radar
    assert radar == read_description(log(LOG)).radar
    three = masks.replace("AR1642", "AR1843").replace("0,0,2,0,\n", "0,0,4,0,\n")
    assert read_description(log(three)).radar.tx_positions == ((0, 0), (4, 0))
    both = LOG.replace("0,0,0,0,0,1,0,", "0,0,0,0,0,3,0,")
    with pytest.raises(ValueError, match=r"fire transmitters \[\[0, 1\], \[1\]\]"):
        read_description(log(both))


def test_what_changes_no_sample_is_no_other_configuration(log):
    """A repeated one, the number of frames, the gain and the filters."""
    started = LOG + "API:SensorStart,0,\n"
    assert read_description(log(started + LOG + started)).notes == ()
    more = LOG.replace("FrameConfig,0,1,3", "FrameConfig,0,1,100")
    more = more.replace("10000,0,0,30,0", "10000,1,1,48,0")
    assert more.count("100,4") and more.count("48")
    assert read_description(log(LOG + more)).notes == ()


def test_the_lanes_that_a_log_enables(log):
    assert read_description(log(LOG)).capture.lanes == 0
    for mask, count in ((3, 2), (15, 4)):
        lanes = f"API:LaneConfig,{mask},0,\n"
        described = read_description(log(lanes + LOG))
        assert described.capture.lanes == count and described.notes == ()
    assert read_description(log(lanes + LOG)).radar == read_description(log(LOG)).radar


def test_the_choice_is_reported_and_can_be_made(tmp_path):
    path = save_studio(tmp_path, random_cube((2, *SHAPE)), LOG + SECOND)
    log = tmp_path / "adc_LogFile.txt"
    sizes = "#1 2 x 4 x 4 x 8, 6.25 m, 0.001 s; #2 2 x 4 x 7 x 8, 7.76 m, 0.001 s"
    with pytest.raises(ValueError, match=f"multiple of 1,792 .* {sizes}"):
        open_recording(path)
    recording = open_recording(path, f"{log}#1")
    assert recording.radar.spec.num_chirps == 4
    assert recording.notes == (
        "adc_LogFile.txt holds 2 configurations (tx x rx x chirps x samples, "
        f"range bin, frame period: {sizes}); #1 was taken, --radar {log}#1 "
        "names another",
    )
    assert "#2 was taken" in read_description(log).notes[0]
    for number in (0, 3):
        with pytest.raises(UsageError, match=f"configuration {number}, expected 1 to"):
            read_description(f"{log}#{number}")
    with pytest.raises(FileNotFoundError, match="no such radar description"):
        read_description(f"{tmp_path / 'none.txt'}#1")
    (tmp_path / "radar.toml").write_text("[radar]\ndevice = 'awr1843'\n")
    with pytest.raises(UsageError, match="configuration = 1 does not apply"):
        read_description(f"{tmp_path / 'radar.toml'}#1")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("ChannelConfig,3,15,0", "ChannelConfig,3", "line 2: 'API:ChannelConfig,3,'"),
        ("ChannelConfig,3,15,0", "ChannelConfig", "line 2: .* 2 or more register"),
        ("ChirpConfig,0,0", "ChirpConfig,0,600", "line 5: .*chirps 0 to 600"),
        ("ChirpConfig,1,1,0,0", "ChirpConfig,1,1,0,9", "differ in profile"),
        ("FrameConfig,0,1", "FrameConfig,0,2", "incomplete configuration"),
        ("FrameConfig,0,1,3,4", "FrameConfig,0,1,3," + "9" * 400, "line 7"),
        ("FrameConfig,0,1,3,4", "FrameConfig,0,1,3,nan", "line 7"),
        ("0,0,0,0,0,0,1,\n", "0,0,0,0,0,0,0,1,\n", "fires transmitters"),
        (",621,", ",-621,", "slope_hz_per_s"),
        ("AR1642", "", "chip , expected one of"),
        ("AR1642", "AR9999", "chip AR9999, expected one of"),
        ("API:ProfileConfig", "API:X", "without ProfileConfig: send all"),
        ("AdcOutConfig,2,1", "AdcOutConfig,2,0", "real samples were recorded"),
        ("0,0,0,1,0,", "0,0,0,1,1,", "expected each chirp to fire one"),
    ],
)
def test_malformed_lines_are_named(log, old, new, message):
    assert old in LOG
    with pytest.raises(ValueError, match=f"LogFile.txt.*{message}"):
        read_description(log(LOG.replace(old, new, 1)))


def test_other_encodings_of_names_are_read(log):
    assert chirps(log("C:\\Müller\\capture,0,\n".encode("cp1252") + LOG.encode())) == 4
