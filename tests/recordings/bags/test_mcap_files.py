"""MCAP files: the same messages as by the package's own reader; sizes that lie."""

import itertools
import operator
import struct

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="pip install 'jradar[ros]'")
from mcap.reader import NonSeekingReader
from mcap.writer import CompressionType, Writer

from jradar.files import open_file
from jradar.recordings.bags import mcap_files
from jradar.recordings.bags.mcap_files import CHUNK, HEAD, MAGIC, McapFile

KINDS = [
    *({"compression": kind} for kind in CompressionType),
    {"use_chunking": False},
    {"use_statistics": False},
    {"repeat_channels": False},
]
STARTS = None, 0, 400, 1000


def write(path, **options):
    """Messages on three topics, whose times jump back and repeat, in small chunks."""
    rng = np.random.default_rng(0)
    with path.open("wb") as file:
        plain = {"compression": CompressionType.NONE, "chunk_size": 500}
        writer = Writer(file, **(plain | options))
        writer.start("ros2", "a test")
        schema = writer.register_schema("a/msg/B", "ros2msg", b"int8 x\n")
        topics = [writer.register_channel(f"/{i}", "cdr", schema) for i in range(3)]
        for number in range(200):
            time = int(5 * number + rng.integers(0, 100) // 10 * 10)
            data = rng.bytes(int(rng.integers(0, 60)))
            writer.add_message(topics[rng.integers(3)], time, data, time, number)
        writer.finish()
    return path


def by_jradar(path, channels=(1, 2, 3), start=None, stop=None):
    file = McapFile(open_file(path), path.name)
    found = [*file.messages(channels, start, stop)]
    file.close()
    return found, file


def by_mcap(path, channels=(1, 2, 3), start=None, stop=None):
    topics = [f"/{channel - 1}" for channel in channels]
    with path.open("rb") as file:
        found = NonSeekingReader(file, validate_crcs=True).iter_messages(
            topics, starting_at=start, ending_before=stop
        )
        return [message for *_, message in found]


@pytest.mark.parametrize("options", KINDS, ids=str)
def test_messages_are_those_of_the_packages_own_reader(tmp_path, options):
    path = write(tmp_path / "a.mcap", **options)
    for start, stop in itertools.combinations_with_replacement(STARTS, 2):
        if stop is None:
            continue
        for channels in ((1, 2, 3), (2,)):
            asked = path, channels, start, stop
            found, file = by_jradar(*asked)
            expected = by_mcap(*asked)
            assert [m.log_time for m in found] == [m.log_time for m in expected]
            by_number = operator.attrgetter("sequence")
            assert sorted(found, key=by_number) == sorted(expected, key=by_number)
    assert sum(file.counts.values()) == 200 and file.notes == ()
    assert file.channels[2].topic == "/1" and file.schemas[1].name == "a/msg/B"


def test_a_chunk_that_is_larger_than_the_limit_is_not_read(tmp_path, monkeypatch):
    path = write(tmp_path / "a.mcap", chunk_size=100_000)
    monkeypatch.setattr(mcap_files, "MOST_BYTES", 2000)  # enough for the summary
    found, file = by_jradar(path)
    (note,) = file.notes
    assert not found and note.startswith("1 damaged chunks in a.mcap are left out")


@pytest.mark.parametrize("kind", CompressionType)
def test_a_file_without_its_end_holds_the_messages_of_its_whole_chunks(tmp_path, kind):
    content = write(tmp_path / "a.mcap", compression=kind).read_bytes()
    ends = [len(MAGIC)]
    while ends[-1] < len(content) - len(MAGIC):
        ends.append(ends[-1] + HEAD.size + HEAD.unpack_from(content, ends[-1])[1])
    chunks = [i for i, at in enumerate(ends) if content[at] == CHUNK]
    at = ends[chunks[3] + 1]  # behind the fourth
    for cut in (at, at + 5, ends[chunks[4] + 1] - 1):
        (tmp_path / "cut.mcap").write_bytes(content[:cut])
        found, file = by_jradar(tmp_path / "cut.mcap")
        assert sum(file.counts.values()) == len(found)
        last = max(message.sequence for message in found)
        assert {m.sequence for m in found} == {*range(last + 1)} and last < 100
        assert f"{len(found)} whole messages" in file.notes[0]


def test_sizes_that_lie_are_not_believed_and_cost_one_chunk(tmp_path):
    path = write(tmp_path / "a.mcap")
    content, (whole, _) = path.read_bytes(), by_jradar(path)
    footer = len(content) - len(MAGIC) - 20
    at = content.index(bytes([CHUNK]), 30)
    lies = {
        "the index of a.mcap is damaged": (footer, len(content)),
        "1 damaged chunks in a.mcap are left out": (at + 1, 1 << 60),
        "1 damaged chunks in a.mcap are left out, with": (at + HEAD.size + 16, 1 << 40),
    }
    for message, (place, value) in lies.items():
        damaged = bytearray(content)
        struct.pack_into("<Q", damaged, place, value)
        path.write_bytes(damaged)
        found, file = by_jradar(path)
        assert len(file.notes) == 1 and file.notes[0].startswith(message)
        left_out = len(whole) - len(found)
        assert left_out == 0 if "index" in message else 0 < left_out < 20
        assert f"with {left_out} messages" in file.notes[0] or "with" not in message


@pytest.mark.parametrize("whole", [True, False])
def test_a_flipped_bit_anywhere_costs_one_chunk_at_most(tmp_path, whole):
    content = write(tmp_path / "a.mcap").read_bytes()
    expected = {message.sequence for message in by_jradar(tmp_path / "a.mcap")[0]}
    end = len(content) - len(MAGIC) - 20 - HEAD.size  # of the summary
    (start,) = struct.unpack_from("<Q", content, end + HEAD.size)
    content = content if whole else content[:start]
    first = content.index(bytes([CHUNK]), 30) + HEAD.size + 40
    places = np.random.default_rng(0).integers(first, end if whole else start, 60)
    noted = 0
    for place in places:
        damaged = bytearray(content)
        damaged[place] ^= 1 << int(place % 8)
        (tmp_path / "bad.mcap").write_bytes(damaged)
        found, file = by_jradar(tmp_path / "bad.mcap")
        lost = expected - {message.sequence for message in found}
        if whole:  # a scan ends where the head of a chunk is damaged
            assert len(lost) < 20
        assert not lost or any(
            "damaged" in note or "cut" in note for note in file.notes
        )
        noted += bool(lost)
    assert noted > 20
