"""`jradar record`: what came from the cable is read back, also after kill -9."""

import dataclasses
import signal
import struct

import numpy as np
import pytest

from jradar.errors import UsageError
from jradar.recordings import describe_file, open_recorder, open_recording
from jradar.recordings.bags.radar_frames import BagRecorder
from jradar.recordings.frame_recorder import FrameRecorder
from tests.programs import finished
from tests.recordings.dca1000_writer import CFG, as_bytes, random_cubes

CUBES = random_cubes(4)
STAMPS = 1.7e9 + 0.1 * np.array([0, 1, 2, 5])  # two frames never came
KILLED = """
import os, pathlib, signal
from tests.recordings.test_frame_recorder import frames, radar
from jradar.recordings import open_recorder
folder, path = map(pathlib.Path, ({folder!r}, {path!r}))
recorder = open_recorder(path, radar(folder))
for frame in frames():
    recorder.write(*frame)
for name, part in {parts!r}:  # of a frame that was being written
    content = (path / name).read_bytes()
    (path / name).write_bytes(content + (part or content[-1500:-700]))
os.kill(os.getpid(), signal.SIGKILL)
"""


def radar(folder):
    (folder / "profile.cfg").write_text(CFG)
    (folder / "adc_data.bin").write_bytes(as_bytes(CUBES))
    return open_recording(folder / "adc_data.bin", folder / "profile.cfg")


def calibrated(folder):
    """The same radar with factors of its channels, a range bias and a mount."""
    source = radar(folder)
    shape = source.radar.spec.num_tx, source.radar.spec.num_rx
    random = np.random.default_rng(0)
    factors = np.exp(1j * random.normal(0, 0.3, shape)).astype(np.complex64)
    known = dataclasses.replace(source.radar, channels=factors, range_bias_m=0.07)
    mount = np.eye(4)
    mount[:3, 3] = 0.1, -0.2, 0.3
    return source._replace(radar=known, base_from_radar=mount)


def recorded(folder, source, name="walk.mcap"):
    """A bag of the frames, in a folder without other descriptions of a radar."""
    with open_recorder(folder / name, source) as recorder:
        for frame in frames():
            recorder.write(*frame)
    return folder / name


def frames():
    for number, (cube, stamp) in enumerate(zip(CUBES, STAMPS, strict=True)):
        data = np.frombuffer(as_bytes([cube]), np.uint8)
        yield data, float(stamp), 1456 * (number == 2)


def check(walk):
    recording = open_recording(walk)
    np.testing.assert_array_equal([*recording.cubes], CUBES)
    np.testing.assert_allclose(recording.cubes.stamps, STAMPS, atol=1e-6)
    assert recording.lost_bytes.tolist() == [0, 0, 1456, 0]
    assert any("1 of 4 frames lost bytes" in note for note in recording.notes)
    return recording


def test_frames_times_and_losses_come_back(tmp_path):
    source = radar(tmp_path)
    assert check(recorded(tmp_path, source, "walk")).radar.spec == source.radar.spec
    with pytest.raises(ValueError, match="never overwritten"):
        FrameRecorder(tmp_path / "walk", source)
    check(tmp_path / "walk")


def killed(folder, path, *parts):
    died = finished(KILLED.format(folder=str(folder), path=str(path), parts=parts))
    assert died.returncode == -signal.SIGKILL, died.stderr
    return check(path)


def test_a_killed_recording_holds_all_whole_frames(tmp_path):
    parts = ("adc_data.bin", bytes(100)), ("frames.txt", b"17000")
    killed(tmp_path, tmp_path / "walk", *parts)


def test_damaged_times_are_named(tmp_path):
    with FrameRecorder(tmp_path / "walk", radar(tmp_path)) as recorder:
        recorder.write(*next(frames()))
    file, toml = tmp_path / "walk" / "frames.txt", tmp_path / "walk" / "capture.toml"
    toml.write_text(toml.read_text().replace("stamps =", "offset_s = 1\nstamps ="))
    with pytest.raises(ValueError, match="has stamps and offset_s"):
        open_recording(tmp_path / "walk")
    toml.write_text(toml.read_text().replace("offset_s = 1\n", ""))
    for text, message in (("", "no frame of frames.txt"), ("x 1\n", "line 1: 'x 1'")):
        file.write_text(text)
        with pytest.raises(ValueError, match=message):
            open_recording(tmp_path / "walk")


@pytest.fixture
def apart(tmp_path):
    """A folder of the source, whose parent holds no description of a radar."""
    pytest.importorskip("rosbags", reason="pip install 'jradar[ros]'")
    (tmp_path / "source").mkdir()
    return tmp_path / "source"


@pytest.mark.parametrize("name", ["walk", "walk.mcap"])
def test_a_calibrated_radar_comes_back_with_its_place(apart, tmp_path, name):
    source = calibrated(apart)
    found = open_recording(recorded(tmp_path, source, name))
    radar, known = found.radar, source.radar
    assert radar.spec == known.spec and radar.range_bias_m == pytest.approx(0.07)
    np.testing.assert_allclose(radar.channels, known.channels, atol=1e-4)
    np.testing.assert_allclose(found.base_from_radar, source.base_from_radar)


def test_a_bag_is_a_recording_of_its_own(apart, tmp_path):
    path = recorded(tmp_path, radar(apart))
    check(path)
    with pytest.raises(UsageError, match="never overwritten"):
        open_recorder(path, radar(apart))
    check(path)
    with pytest.raises(ValueError, match=r"expected the name of .* walk\.mcap"):
        open_recorder(tmp_path / "walk.db3", radar(apart))
    with pytest.raises(UsageError, match="device = 'awr1843' does not apply"):
        open_recording(path, device="awr1843")
    topics = {row["topic"]: row for row in describe_file(path)["topics"]}
    assert topics["/radar/frames"]["messages"] == len(CUBES)


def test_other_readers_of_mcap_decode_a_bag(apart, tmp_path):
    mcap, rosbags = (pytest.importorskip(m) for m in ("mcap.reader", "rosbags"))
    from rosbags.highlevel import AnyReader

    path = recorded(tmp_path, radar(apart))
    with path.open("rb") as file:
        reader = mcap.make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary.statistics.message_count == 2 + len(CUBES)
        assert len([*reader.iter_messages()]) == 2 + len(CUBES)
    assert rosbags
    with AnyReader([path]) as reader:
        (topic,) = (c for c in reader.connections if c.topic == "/radar/frames")
        for index, (_, time, raw) in enumerate(reader.messages([topic])):
            frame = reader.deserialize(raw, topic.msgtype)
            stamp = frame.header.stamp
            assert stamp.sec * 10**9 + stamp.nanosec == time
            assert frame.header.frame_id == "radar"
            assert frame.lost_bytes == 1456 * (index == 2)
            assert frame.samples.tobytes() == as_bytes([CUBES[index]])


def test_a_killed_bag_holds_all_whole_frames(apart, tmp_path):
    recording = killed(apart, tmp_path / "walk.mcap", ("", b""))
    assert any("cut off: its 6 whole messages" in note for note in recording.notes)
    assert any("cut off" in n for n in describe_file(tmp_path / "walk.mcap")["notes"])


@pytest.mark.parametrize("keep", [0.1, 0.3, 0.5, 0.9, 0.999])
def test_a_bag_that_was_cut_off_gives_its_whole_frames(apart, tmp_path, keep):
    content = recorded(tmp_path, radar(apart)).read_bytes()
    path = tmp_path / "cut.mcap"
    path.write_bytes(content[: int(keep * len(content))])
    if keep < 0.4:  # before the first whole frame
        with pytest.raises(ValueError, match="cut.mcap"):
            open_recording(path)
        return
    found = open_recording(path)
    count = len(found.cubes)
    assert 0 < count <= len(CUBES) and (count == len(CUBES)) == (keep > 0.9)
    np.testing.assert_array_equal([*found.cubes], CUBES[:count])


@pytest.mark.parametrize("end", [None, -100], ids=["whole", "cut off"])
def test_a_damaged_chunk_costs_its_frames_and_is_counted(apart, tmp_path, end):
    content = bytearray(recorded(tmp_path, radar(apart)).read_bytes())
    content[content.find(as_bytes([CUBES[1]]))] ^= 0xFF
    (tmp_path / "bad.mcap").write_bytes(content[:end])
    found = open_recording(tmp_path / "bad.mcap")
    np.testing.assert_array_equal([*found.cubes], CUBES[[0, 2, 3]])
    note = "1 damaged chunks in bad.mcap are left out, with"
    assert any(text.startswith(note) for text in found.notes)


@pytest.mark.parametrize("end", [None, -100], ids=["whole", "cut off"])
@pytest.mark.parametrize("what", [b"RadarFrame", b"/radar/frames", b"iq_order"])
def test_no_chunk_alone_describes_the_file(apart, tmp_path, what, end):
    content = bytearray(recorded(tmp_path, radar(apart)).read_bytes())
    chunk = content.find(b"\x06", content.find(b"/radar/frames"))
    content[content.find(what, chunk)] ^= 0xFF  # in the first chunk
    (tmp_path / "bad.mcap").write_bytes(content[:end])
    found = open_recording(tmp_path / "bad.mcap")
    np.testing.assert_array_equal([*found.cubes], CUBES)
    assert any("1 damaged chunks" in note for note in found.notes)


def test_a_damaged_description_is_named(apart, tmp_path):
    path = recorded(tmp_path, radar(apart))
    path.write_bytes(path.read_bytes()[:-8].replace(b"num_rx", b"num_xx"))
    content = path.read_bytes()
    for old, new in ((b"iq_order = ", b"iq_ordxx = "), (b"[radar]", b"[[[[[[[")):
        changed = unchecked(content).replace(old, new)
        path.write_bytes(changed)
        with pytest.raises(ValueError, match="walk.mcap, /radar/description"):
            open_recording(path)


def unchecked(content):
    """The chunks of a file without their checksums."""
    content, at = bytearray(content), 8
    while at < len(content):
        kind, size = struct.unpack_from("<BQ", content, at)
        if kind == 6:
            content[at + 9 + 24 : at + 9 + 28] = bytes(4)
        at += 9 + size
    return bytes(content)


def test_a_clock_that_jumps_back_keeps_the_order(apart, tmp_path):
    stamps = [1.7e9, 1.7e9 + 0.1, 1.7e9 - 60, 1.7e9 - 59.9]
    with BagRecorder(tmp_path / "walk.mcap", radar(apart)) as recorder:
        for (data, *_), stamp in zip(frames(), stamps, strict=True):
            recorder.write(data, stamp)
    found = open_recording(tmp_path / "walk.mcap")
    np.testing.assert_array_equal([*found.cubes], CUBES)
    assert any("not rising" in note for note in found.notes)


@pytest.mark.parametrize("name", ["walk", "walk.mcap"])
def test_a_full_disk_is_named_and_leaves_the_frames_before(apart, small_disk, name):
    path, written = small_disk / name, 0
    source, (frame, *_) = radar(apart), frames()
    with pytest.raises(OSError, match=f"{name} cannot be written .*is the disk full"):
        with open_recorder(path, source) as recorder:
            for written in range(100_000):
                recorder.write(frame[0], 1.7e9 + 0.1 * written)
    assert len(open_recording(path).cubes) == written > 5


def test_a_bag_of_frames_and_one_of_clouds_are_joined(apart, tmp_path):
    from tests.recordings.bag_writer import livox_bag, livox_rows

    recorded(tmp_path, radar(apart))
    clouds = [livox_rows(5), livox_rows(6)]
    livox_bag(tmp_path, "mcap", clouds, start=17 * 10**17)
    toml = tmp_path / "capture.toml"
    text = '[radar]\nfile = "walk.mcap"\nadd_s = 0.03\nxyz = [0, 0, 0.1]\n'
    text += '[lidar]\nfile = "mcap"\n'
    toml.write_text(text)
    found = open_recording(tmp_path)
    np.testing.assert_array_equal([*found.cubes], CUBES)
    np.testing.assert_allclose(found.cubes.stamps, STAMPS + 0.03, atol=1e-6)
    assert found.lost_bytes.tolist() == [0, 0, 1456, 0] and len(found.lidar) == 2
    assert found.base_from_radar[2, 3] == 0.1
    known = calibrated(apart)
    (tmp_path / "walk.mcap").unlink()
    recorded(tmp_path, known)
    found = open_recording(tmp_path)
    np.testing.assert_allclose(found.base_from_radar, known.base_from_radar)
    assert any("place is that in walk.mcap, [mount]" in note for note in found.notes)
    for key in ("start_time_s = 3", "offset_s = 0.1", "allow_partial = true"):
        toml.write_text(text.replace("add_s = 0.03", key))
        with pytest.raises(UsageError, match=f"has {key.split()[0]}, but the frames"):
            open_recording(tmp_path)
