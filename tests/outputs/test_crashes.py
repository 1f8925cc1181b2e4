"""What is left of an output after kill -9, a full disk, or a second writer."""

import contextlib
import functools
import os
import signal
import struct
import time

import jax
import pytest

from jradar.errors import UsageError
from jradar.outputs import messages
from jradar.outputs.writers import open_writer
from tests.outputs.scenes import frame_of

NAMES = "out.mcap", "out.ros2"
FRAMES = 40


@pytest.fixture(autouse=True, scope="module")
def packages(tmp_path_factory):
    """What a writer loads is loaded here, and not in each process that is killed."""
    for package in ("foxglove", "rosbags", "mcap"):
        pytest.importorskip(package)
    for name in NAMES:
        with contextlib.closing(open_writer(tmp_path_factory.mktemp("a") / name)) as w:
            w.write(frame_of(0, points=1))


@functools.cache
def frames():
    """The frames that are written."""
    return jax.device_get([frame_of(n, points=5000) for n in range(FRAMES)])


@pytest.fixture
def save_all(monkeypatch):
    """Outputs are saved after each frame, not once a second."""
    monkeypatch.setattr(messages, "SAVED_S", 0.0)


def file_of(path):
    """The file of an output, which is in a folder if it is a bag."""
    return path if path.suffix == ".mcap" else path / f"{path.name}.mcap"


def scanned_times(path):
    """Times of the messages of an MCAP file that may have no end, in file order."""
    from mcap import exceptions, records, stream_reader

    times = []
    with file_of(path).open("rb") as file:
        with contextlib.suppress(exceptions.McapError, struct.error, EOFError):
            for record in stream_reader.StreamReader(file).records:
                if isinstance(record, records.Message):
                    times.append(record.log_time)
    return times


def indexed_times(path):
    """Times of the messages of a whole MCAP file, by the index at its end."""
    from mcap.reader import make_reader

    with file_of(path).open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None and summary.chunk_indexes
        return [message.log_time for *_, message in reader.iter_messages()]


def times_of(frames):
    """Times of the four messages of each of so many frames."""
    return [stamp_ns(n) for n in range(frames) for _ in range(4)]


@functools.cache
def stamp_ns(number):
    return frame_of(number, points=1).stamp_ns


def killed(path, wanted):
    """Write frames in a process that is killed; return how many it had written.

    It is killed when it has written the `wanted` number, while it writes the next one.
    """
    written = frames()
    read, told = os.pipe()
    if (child := os.fork()) == 0:
        try:
            writer = open_writer(path)
            for frame in written:
                writer.write(frame)
                os.write(told, b".")
            time.sleep(60)
        finally:
            os._exit(1)
    os.close(told)
    count = sum(len(os.read(read, 1)) for _ in range(wanted))
    os.kill(child, signal.SIGKILL)
    assert os.waitpid(child, 0)[1] == signal.SIGKILL
    with open(read, "rb") as file:
        return count + len(file.read())


@pytest.mark.parametrize("name", NAMES)
def test_a_program_that_is_killed_at_any_moment_loses_nothing_saved(
    tmp_path, save_all, name
):
    """Twenty times; the last frame may be there or not."""
    counts = []
    for number in range(1, 21):
        path = tmp_path / f"{number}{name}"
        counts.append(killed(path, number))
        times = scanned_times(path)
        assert times in (times_of(counts[-1]), times_of(min(counts[-1] + 1, FRAMES)))


@pytest.mark.parametrize("name", NAMES)
def test_an_output_of_a_killed_program_is_whole_after_each_save(
    tmp_path, save_all, name
):
    """Once a second in earnest, after each frame here."""
    assert killed(tmp_path / name, FRAMES) == FRAMES
    assert indexed_times(tmp_path / name) == times_of(FRAMES)
    if name == "out.ros2":
        from rosbags.highlevel import AnyReader

        with AnyReader([tmp_path / name]) as reader:
            assert [time_ns for _, time_ns, _ in reader.messages()] == times_of(FRAMES)
        text = (tmp_path / name / "metadata.yaml").read_text()
        assert f"message_count: {4 * FRAMES}" in text


@pytest.mark.parametrize("name", NAMES)
def test_a_program_killed_between_two_saves_leaves_whole_chunks(
    tmp_path, monkeypatch, name
):
    monkeypatch.setattr(messages, "SAVED_S", 1e9)
    assert killed(tmp_path / name, FRAMES) == FRAMES
    found = scanned_times(tmp_path / name)
    assert len(found) > 4 * 20 and found == times_of(FRAMES)[: len(found)]
    if name == "out.ros2":
        text = (tmp_path / name / "metadata.yaml").read_text()
        assert "message_count: 4\n" in text


@pytest.mark.parametrize("name", NAMES)
def test_what_came_before_a_pause_is_safe_after_a_second(tmp_path, monkeypatch, name):
    writer = open_writer(tmp_path / name)
    for number in range(3):
        writer.write(frame_of(number))
    writer.save()
    assert len(scanned_times(tmp_path / name)) < 12
    monkeypatch.setattr(messages, "SAVED_S", 0.0)
    writer.save()
    assert indexed_times(tmp_path / name) == times_of(3)
    writer.write(frame_of(3))
    writer.close()
    assert indexed_times(tmp_path / name) == times_of(4)


@pytest.mark.parametrize("name", NAMES)
def test_a_full_disk_is_named_and_leaves_a_whole_file(small_disk, save_all, name):
    from jradar.recordings import describe_file

    path, whole = small_disk / name, 0
    writer = open_writer(path)
    with pytest.raises(OSError, match=rf"{name}.* cannot be written .*the disk full"):
        for whole in range(100):
            writer.write(frame_of(whole, points=5000))
    writer.close()
    assert whole > 5 and scanned_times(path) == times_of(whole)
    found = {row["topic"]: row["messages"] for row in describe_file(path)["topics"]}
    assert found["/radar/points"] >= whole - 1


def test_a_bag_that_met_a_full_disk_is_read_by_others(small_disk, save_all):
    from rosbags.highlevel import AnyReader

    path, whole = small_disk / "out.ros2", 0
    with pytest.raises(OSError, match="the disk full"):
        with contextlib.closing(open_writer(path)) as writer:
            for whole in range(100):
                writer.write(frame_of(whole, points=5000))
    with AnyReader([path]) as reader:
        assert [time_ns for _, time_ns, _ in reader.messages()] == times_of(whole)


@pytest.mark.parametrize("name", NAMES)
def test_a_second_writer_that_comes_between_is_refused(tmp_path, name):
    """Both have looked before either of them has created the output."""
    from jradar.outputs.foxglove import FoxgloveWriter
    from jradar.outputs.ros2 import BagWriter

    create = BagWriter if name == "out.ros2" else FoxgloveWriter
    first = create(tmp_path / name)
    with pytest.raises(UsageError, match="exists and is not overwritten"):
        create(tmp_path / name)
    first.write(frame_of(0))
    first.close()
