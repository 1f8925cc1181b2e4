"""`jradar record`: what came from the cable is read back, also after kill -9."""

import signal

import numpy as np
import pytest

from jradar.recordings import FrameRecorder, open_recording
from tests.programs import finished
from tests.recordings.dca1000_writer import CFG, as_bytes, random_cubes

CUBES = random_cubes(4)
STAMPS = 1.7e9 + 0.1 * np.array([0, 1, 2, 5])  # two frames never came
KILLED = """
import os, pathlib, signal
from tests.recordings.test_frame_recorder import frames, radar
from jradar.recordings import FrameRecorder
folder = pathlib.Path({folder!r})
recorder = FrameRecorder(folder / "walk", radar(folder))
for frame in frames():
    recorder.write(*frame)
with (folder / "walk" / "adc_data.bin").open("ab") as file:
    file.write(bytes(100))  # a frame that was being written
with (folder / "walk" / "frames.txt").open("a") as file:
    file.write("17000")
os.kill(os.getpid(), signal.SIGKILL)
"""


def radar(folder):
    (folder / "profile.cfg").write_text(CFG)
    (folder / "adc_data.bin").write_bytes(as_bytes(CUBES))
    return open_recording(folder / "adc_data.bin", folder / "profile.cfg")


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
    with FrameRecorder(tmp_path / "walk", source) as recorder:
        for frame in frames():
            recorder.write(*frame)
    assert check(tmp_path / "walk").radar.spec == source.radar.spec
    with pytest.raises(ValueError, match="never overwritten"):
        FrameRecorder(tmp_path / "walk", source)
    check(tmp_path / "walk")


def test_a_killed_recording_holds_all_whole_frames(tmp_path):
    died = finished(KILLED.format(folder=str(tmp_path)))
    assert died.returncode == -signal.SIGKILL, died.stderr
    check(tmp_path / "walk")


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
