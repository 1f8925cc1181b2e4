"""What can be read of an MCAP file of ROS 2 messages that has no end.

A recorder that was killed, or a computer that lost its power, leaves

    header | chunk, index | chunk, index | half a chunk

A scan finds the messages of all chunks that are whole; a chunk whose checksum is wrong
is left out. `CutOffMcap` stands in for the reader of rosbags.
"""

import io
import struct
import zlib
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import NamedTuple

from jradar.files import open_file
from jradar.recordings.bags.foxglove import (
    CHANNEL,
    CHUNK,
    DATA_END,
    HEADER,
    MAGIC,
    MESSAGE,
    SCHEMA,
)
from jradar.recordings.bags.unpacking import MOST_BYTES, limit_rosbags

HEAD = struct.Struct("<BQ")  # of a record: its kind and size
CHUNK_HEAD = struct.Struct("<QQQII")  # times, unpacked size, checksum, a text's length
MOST_TEXT = 1 << 20  # bytes of a definition


class Definition(NamedTuple):
    """The definition of a type of messages."""

    data: str


class Connection(NamedTuple):
    """A topic of the file."""

    number: int
    topic: str
    msgtype: str
    msgdef: Definition


class Topic(NamedTuple):
    """What a topic holds."""

    msgtype: str
    msgcount: int


class _Place(NamedTuple):
    """Where a message is: the chunk in the file, and the bytes in the chunk."""

    time: int
    channel: int
    chunk: int
    start: int
    stop: int


def is_cut_off(path: Path) -> bool:
    """Whether a file begins as MCAP does, and does not end so."""
    if path.suffix != ".mcap" or not path.is_file():
        return False
    with open_file(path) as file:
        begin = file.read(len(MAGIC))
        size = file.seek(0, io.SEEK_END)
        file.seek(max(size - len(MAGIC), 0))
        return begin == MAGIC and (size == len(MAGIC) or file.read() != MAGIC)


class CutOffMcap:
    """The whole messages of a file without an end, read like a bag of rosbags."""

    def __init__(self, path: Path):
        """Scan the file; ValueError if it holds no whole message of ROS 2."""
        self.path, self._places = path, list[_Place]()
        self._schemas: dict[int, tuple[str, str]] = {}
        self._channels: dict[int, Connection] = {}
        self._cached = -1, b""
        self._file = open_file(path)
        end = self._file.seek(0, io.SEEK_END)
        damaged, at = 0, len(MAGIC)
        while (record := self._record(at, end)) and record[0] in range(1, DATA_END):
            kind, size = record
            if kind == CHUNK:
                try:
                    self._scan(at)
                except Exception:  # damaged bytes can raise anything
                    damaged += 1
            elif kind == HEADER and b"ros2" not in self._file.read(min(size, 64)):
                raise ValueError("Profile is not ros2")
            at += HEAD.size + size
        if not self._places:
            raise ValueError("it was cut off before its first message")
        self._places.sort(key=lambda place: place.time)
        span = (self._places[-1].time - self._places[0].time) / 1e9
        self.notes: tuple[str, ...] = (
            f"{path.name} was cut off: its {len(self._places):,} whole messages, of "
            f"{span:.1f} s, are read; {end - at:,} bytes at its end are not",
        )
        if damaged:
            self.notes += (f"{damaged} damaged chunks in {path.name} are left out",)

    @property
    def connections(self) -> list[Connection]:
        """All topics."""
        return [*self._channels.values()]

    @property
    def topics(self) -> dict[str, Topic]:
        """Type and number of messages of each topic."""
        count = dict.fromkeys(self._channels, 0)
        for place in self._places:
            count[place.channel] += 1
        return {c.topic: Topic(c.msgtype, count[c.number]) for c in self.connections}

    def messages(
        self,
        connections: Collection[Connection],
        start: int | None = None,
        stop: int | None = None,
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield connection, time and bytes of messages in the order of their times."""
        chosen = {connection.number for connection in connections}
        for place in self._places:
            after = start is None or place.time >= start
            if (
                after
                and place.channel in chosen
                and (stop is None or place.time < stop)
            ):
                inside = self._chunk(place.chunk)[place.start : place.stop]
                yield self._channels[place.channel], place.time, inside

    def _record(self, at: int, end: int) -> tuple[int, int] | None:
        """Kind and size of the record at a place; None if it is not whole."""
        self._file.seek(at)
        head = self._file.read(HEAD.size)
        if len(head) < HEAD.size:
            return None
        kind, size = HEAD.unpack(head)
        return (kind, size) if at + HEAD.size + size <= end else None

    def _chunk(self, at: int) -> bytes:
        """The unpacked content of the chunk at a place; ValueError if it is damaged."""
        if self._cached[0] == at:
            return self._cached[1]
        self._file.seek(at + HEAD.size)
        *_, size, check, length = CHUNK_HEAD.unpack(self._file.read(CHUNK_HEAD.size))
        name = self._file.read(length).decode()
        (packed,) = struct.unpack("<Q", self._file.read(8))
        if max(size, packed) > MOST_BYTES:
            raise ValueError(f"a chunk of {size:,} bytes")
        inside = self._file.read(packed)
        if name:
            from rosbags.rosbag2.storage_mcap import DECOMPRESSORS

            limit_rosbags()
            inside = DECOMPRESSORS[name](inside, size)
        if len(inside) != size or (check and zlib.crc32(inside) != check):
            raise ValueError("a chunk has a wrong checksum")
        self._cached = at, inside
        return inside

    def _scan(self, at: int) -> None:
        """Add what the chunk at a place holds."""
        inside, start = self._chunk(at), 0
        while start < len(inside):
            kind, size = HEAD.unpack_from(inside, start)
            start, stop = start + HEAD.size, start + HEAD.size + size
            content = io.BytesIO(inside[start : min(stop, start + MOST_TEXT)])
            if kind == SCHEMA:
                (number,) = struct.unpack("<H", content.read(2))
                name, _, text = (_text(content) for _ in range(3))
                self._schemas[number] = name, text
            elif kind == CHANNEL:
                number, schema = struct.unpack("<HH", content.read(4))
                name, text = self._schemas[schema]
                found = Connection(number, _text(content), name, Definition(text))
                self._channels[number] = found
            elif kind == MESSAGE:
                channel, _, time = struct.unpack("<HIQ", content.read(14))
                if channel in self._channels and stop <= len(inside):
                    self._places.append(_Place(time, channel, at, start + 22, stop))
            start = stop


def _text(content: io.BytesIO) -> str:
    (size,) = struct.unpack("<I", content.read(4))
    return content.read(size).decode()
