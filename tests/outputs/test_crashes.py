"""What is left of an output after kill -9, a full disk, or a second writer."""

import contextlib
import importlib
import signal
import struct

import pytest

from jradar.errors import UsageError
from jradar.outputs.writers import open_writer
from tests.outputs.scenes import frame_of
from tests.programs import finished

KILLED = """
import os, pathlib, signal
from tests.outputs.scenes import frame_of
from jradar.outputs import foxglove, ros2
folder = pathlib.Path({folder!r})
foxglove.FLUSHED_S = 0.0
writers = {{
    0.0: foxglove.McapWriter(folder / "out.mcap"),
    1e-9: ros2.BagWriter(folder / "saved.ros2"),
    1e9: ros2.BagWriter(folder / "open.ros2"),
}}
for number in range(40):
    for ros2.SAVED_S, writer in writers.items():
        writer.write(frame_of(number, points=5000))
os.kill(os.getpid(), signal.SIGKILL)
"""
WRITERS = {
    "out.mcap": ("foxglove", "McapWriter"),
    "out.ros2": ("ros2", "BagWriter"),
}


@pytest.fixture(autouse=True, scope="module")
def packages():
    for package in ("foxglove", "rosbags", "mcap"):
        pytest.importorskip(package)


def scanned_times(path):
    """Times of the messages of an MCAP file that may have no end, in file order."""
    from mcap import exceptions, records, stream_reader

    times = []
    with path.open("rb") as file:
        with contextlib.suppress(exceptions.McapError, struct.error, EOFError):
            for record in stream_reader.StreamReader(file).records:
                if isinstance(record, records.Message):
                    times.append(record.log_time)
    return times


def times_of(views):
    """Times of the four messages of each of so many views."""
    return [frame_of(n, points=1).stamp_ns for n in range(views) for _ in range(4)]


@pytest.fixture(scope="module")
def killed(tmp_path_factory, packages):
    """Outputs of a killed program of 40 views: saved after each, and never saved."""
    folder = tmp_path_factory.mktemp("killed")
    done = finished(KILLED.format(folder=str(folder)))
    assert done.returncode == -signal.SIGKILL, done.stderr
    return folder


def test_an_mcap_file_of_a_killed_program_is_read_up_to_its_last_chunk(killed):
    assert sorted(scanned_times(killed / "out.mcap")) == times_of(40)


def test_a_bag_of_a_killed_program_is_whole_after_each_save(killed):
    """Once a second in earnest, after each view here."""
    from rosbags.highlevel import AnyReader

    path = killed / "saved.ros2"
    assert scanned_times(path / "saved.ros2.mcap") == times_of(40)
    with AnyReader([path]) as reader:
        assert [time_ns for _, time_ns, _ in reader.messages()] == times_of(40)
    assert "message_count: 160" in (path / "metadata.yaml").read_text()


def test_a_bag_of_a_program_killed_between_two_saves_is_scanned(killed):
    found = scanned_times(killed / "open.ros2" / "open.ros2.mcap")
    assert len(found) > 4 * 20 and found == times_of(40)[: len(found)]
    assert "message_count: 4\n" in (killed / "open.ros2/metadata.yaml").read_text()


@pytest.mark.parametrize("name", WRITERS)
def test_what_came_before_a_pause_is_safe_after_a_second(tmp_path, monkeypatch, name):
    from jradar.outputs import foxglove, ros2

    path = tmp_path / name
    writer = open_writer(path)
    for number in range(3):
        writer.write(frame_of(number))
    file = path if path.is_file() else path / f"{name}.mcap"
    writer.save()
    assert len(scanned_times(file)) < 12
    monkeypatch.setattr(ros2, "SAVED_S", 0.0)
    monkeypatch.setattr(foxglove, "FLUSHED_S", 0.0)
    writer.save()
    assert sorted(scanned_times(file)) == times_of(3)
    writer.write(frame_of(3))
    writer.close()
    assert sorted(scanned_times(file)) == times_of(4)


@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_is_named_and_leaves_a_whole_bag(small_disk, monkeypatch, name):
    from rosbags.highlevel import AnyReader

    from jradar.outputs import foxglove, ros2

    monkeypatch.setattr(ros2, "SAVED_S", 0.0)
    monkeypatch.setattr(foxglove, "FLUSHED_S", 0.0)
    path, whole = small_disk / name, 0
    writer = open_writer(path)
    with pytest.raises(OSError, match=rf"{name} cannot be written .*the disk full"):
        for whole in range(100):
            writer.write(frame_of(whole, points=5000))
    if name == "out.mcap":  # whose end does not fit
        with contextlib.suppress(OSError):
            writer.close()
        return
    writer.close()
    assert whole > 5
    with AnyReader([path]) as reader:
        assert [time_ns for _, time_ns, _ in reader.messages()] == times_of(whole)


@pytest.mark.parametrize("name", WRITERS)
def test_a_second_writer_that_comes_between_is_refused(tmp_path, name):
    """Both have looked before either of them has created the output."""
    module, kind = WRITERS[name]
    create = getattr(importlib.import_module(f"jradar.outputs.{module}"), kind)
    first = create(tmp_path / name)
    with pytest.raises(UsageError, match="exists and is not overwritten"):
        create(tmp_path / name)
    first.write(frame_of(0))
    first.close()
