"""What an MCAP file holds, read by the package `mcap` with limits of our own.

    magic | header | chunk, index | chunk, index .. | summary | footer, magic
                                                      ^ summary_start

The package trusts every size in a file, and unpacks a chunk however large it becomes.
Here a record ends at the end of the file at the latest, a chunk is unpacked up to a
limit, and the package parses both from memory. If the recorder was killed, or the
computer lost its power, a file can end anywhere:

    magic | header | chunk, index | chunk, index | half a chunk

A file without a summary, or with a damaged one, is scanned: the messages of all whole
chunks are found. A chunk whose checksum is wrong is left out, and `notes` count it.
"""

import heapq
import io
import struct
import zlib
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from jradar.errors import optional, parsing
from jradar.files import open_file
from jradar.recordings.bags.unpacking import MOST_BYTES, unpack

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")  # of a record: its kind and size
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX = 1, 2, 3, 4, 5, 6, 7
DATA_END = 15
FOOTER_BYTES = 20


class Part(NamedTuple):
    """Where a chunk, or a message outside of chunks, begins, and what it holds."""

    at: int
    first_ns: int
    last_ns: int
    channels: frozenset[int]  # empty if they are not known


class McapFile:
    """Schemas, channels and messages of a file; `notes` say what cannot be read.

    A damaged chunk may be found when its messages are read.
    """

    def __init__(self, file: BinaryIO, name: str):
        """Read the summary, or scan; ValueError if there is no whole message."""
        need = f"{name} needs mcap"
        self._records = optional("mcap.records", need=need, extra="ros")
        self._reader = optional("mcap.stream_reader", need=need, extra="ros")
        self._file, self._size, self._name = file, file.seek(0, io.SEEK_END), name
        self.schemas, self.channels = dict[int, Any](), dict[int, Any]()
        self.counts, self._lost = Counter[int](), Counter[int]()  # by channel
        self._damaged, self._notes = list[Exception](), tuple[str, ...]()
        self._parts = list[Part]()
        self._latest: tuple[int, list[Any]] = -1, []  # part, and what is in it
        try:
            summary = self._summary()
            known = bool(summary) and self._take(summary)
        except Exception:  # damaged bytes can raise anything
            summary, known = [], False
            self._notes += (f"the index of {name} is damaged: its chunks are read",)
        if not known:
            self._scan(cut_off=summary is None)
        self._parts.sort(key=lambda part: part.first_ns)
        self.close = file.close

    @property
    def notes(self) -> tuple[str, ...]:
        """What is missing so far."""
        if not self._damaged:
            return self._notes
        count, lost = len(self._damaged), self._lost.total()
        note = f"{count} damaged chunks in {self._name} are left out"
        note += f", with {lost} messages" if lost else ""
        return *self._notes, f"{note} ({self._damaged[0]})"

    @property
    def span_ns(self) -> tuple[int, int]:
        """The first and the last time of a message; zeros without any."""
        last = max((part.last_ns for part in self._parts), default=0)
        return min((part.first_ns for part in self._parts), default=0), last

    def messages(
        self,
        channels: Collection[int],
        start: int | None = None,
        stop: int | None = None,
    ) -> Iterator[Any]:
        """Yield the messages of channels from `start` to before `stop`, by their times.

        A chunk that is damaged or too large is left out.
        """
        begin, end = -1 if start is None else start, 1 << 64 if stop is None else stop
        waiting, order = [], 0  # a heap of messages that a later part may precede
        for part in [*self._parts]:
            if part.last_ns < begin or part.first_ns >= end:
                continue
            if part.channels and part.channels.isdisjoint(channels):
                continue
            while waiting and waiting[0][0] < part.first_ns:
                yield heapq.heappop(waiting)[-1]
            try:
                found = [*self._messages(part.at)]
            except Exception as error:  # damaged bytes can raise anything
                self._parts.remove(part)
                self._lose(part.at, error)
                continue
            for message in found:
                if begin <= message.log_time < end and message.channel_id in channels:
                    order += 1
                    heapq.heappush(waiting, (message.log_time, order, message))
        while waiting:
            yield heapq.heappop(waiting)[-1]

    def _summary(self) -> list[Any] | None:
        """Return the summary's records: [] without a summary, None without an end."""
        at = self._size - HEAD.size - FOOTER_BYTES - len(MAGIC)
        footer = self._read(max(at, 0), self._size)
        if not footer.endswith(MAGIC) or HEAD.unpack_from(footer) != (FOOTER, 20):
            return None
        start, _, check = struct.unpack_from("<QQI", footer, HEAD.size)
        if not start:
            return []
        if not len(MAGIC) < start <= at or at - start > MOST_BYTES:
            raise ValueError(f"its summary begins at byte {start:,} of {at:,}")
        checked = self._read(start, self._size - len(MAGIC) - 4)
        if check and zlib.crc32(checked) != check:
            raise ValueError("its summary has a wrong checksum")
        read = self._reader.StreamReader
        stream = io.BytesIO(self._read(start, self._size))
        return [*read(stream, skip_magic=True, emit_chunks=True).records]

    def _take(self, summary: list[Any]) -> bool:
        """Take the index from a summary; return whether it is complete."""
        counted = None
        for record in summary:
            self._describe(record)
            if isinstance(record, self._records.Statistics):
                counted = record
            elif isinstance(record, self._records.ChunkIndex):
                span = record.message_start_time, record.message_end_time
                channels = frozenset(record.message_index_offsets)
                self._parts.append(Part(record.chunk_start_offset, *span, channels))
        if counted is None or len(self._parts) != counted.chunk_count:
            return False
        if counted.message_count and not (self._parts and self.channels):
            return False
        self.counts.update(counted.channel_message_counts)
        return True

    def _scan(self, *, cut_off: bool) -> None:
        for found in (self._parts, self.schemas, self.channels, self.counts):
            found.clear()
        at = len(MAGIC)
        while (head := self._head(at)) and head[0] in range(1, DATA_END):
            if head[0] in (SCHEMA, CHANNEL, MESSAGE, CHUNK):
                try:
                    self._add(at)
                except Exception as error:  # damaged bytes can raise anything
                    self._lose(at, error)
            at += HEAD.size + head[1]
        if not self._parts and (cut_off or self._damaged):
            raise ValueError("it was cut off before its first message")
        if cut_off:
            first, last = self.span_ns
            whole, seconds = self.counts.total(), 1e-9 * (last - first)
            self._notes += (
                f"{self._name} was cut off: its {whole:,} whole messages, of "
                f"{seconds:.1f} s, are read; {self._size - at:,} bytes at its end are "
                "not",
            )

    def _lose(self, at: int, error: Exception) -> None:
        """Count a damaged part, and its messages by the indexes that follow it."""
        self._damaged.append(error)
        lost, head = Counter[int](), self._head(at)
        while head is not None:
            at += HEAD.size + head[1]
            head = self._head(at)
            if head is None or head[0] != MESSAGE_INDEX:
                break
            (channel,) = struct.unpack("<H", self._read(at + HEAD.size, at + 11))
            lost[channel] += (head[1] - 6) // 16
        self._lost += lost
        self.counts -= lost

    def _add(self, at: int) -> None:
        """Add a part if it holds messages, and the schemas and channels in it."""
        found = [*self._messages(at)]
        for record in self._latest[1]:
            self._describe(record)
        if found:
            times = [message.log_time for message in found]
            counts = Counter(message.channel_id for message in found)
            self._parts.append(Part(at, min(times), max(times), frozenset(counts)))
            self.counts += counts

    def _describe(self, record: Any) -> None:
        if isinstance(record, self._records.Schema):
            self.schemas[record.id] = record
        elif isinstance(record, self._records.Channel):
            self.channels[record.id] = record

    def _messages(self, at: int) -> Iterator[Any]:
        """Yield the messages of a part; ValueError if it is damaged or too large."""
        if self._latest[0] != at:
            kind, size = self._head(at) or (0, 0)
            if kind not in (SCHEMA, CHANNEL, MESSAGE, CHUNK) or size > MOST_BYTES:
                raise ValueError(f"there is no chunk at byte {at:,}")
            data = self._read(at, at + HEAD.size + size)
            if kind == CHUNK:
                data = self._unpacked(io.BytesIO(data))
            whole = self._records.Chunk("", data, 0, 0, 0, len(data))
            self._latest = at, self._reader.breakup_chunk(whole)
        for record in self._latest[1]:
            if isinstance(record, self._records.Message):
                yield record

    def _unpacked(self, record: io.BufferedIOBase) -> bytes:
        record.seek(HEAD.size)
        chunk = self._records.Chunk.read(self._reader.ReadDataStream(record))
        size, check = chunk.uncompressed_size, chunk.uncompressed_crc
        data = unpack(chunk.compression, chunk.data)
        if len(data) != size or (check and zlib.crc32(data) != check):
            raise ValueError("a chunk has a wrong size or checksum")
        return data

    def _head(self, at: int) -> tuple[int, int] | None:
        """Return kind and size of the record at a place; None if it is not whole."""
        head = self._read(at, at + HEAD.size)
        if len(head) < HEAD.size:
            return None
        kind, size = HEAD.unpack(head)
        return (kind, size) if at + HEAD.size + size <= self._size else None

    def _read(self, begin: int, end: int) -> bytes:
        self._file.seek(begin)
        return self._file.read(end - begin)


def mcap_profile(path: Path) -> str | None:
    """Return the profile that an MCAP file begins with; None for other files."""
    if path.suffix != ".mcap" or not path.is_file():
        return None
    with open_file(path) as file:
        begin = file.read(len(MAGIC) + HEAD.size + 1024)
    text = begin[len(MAGIC) + HEAD.size :]
    profile = text[4 : 4 + int.from_bytes(text[:4], "little")]
    is_mcap = begin.startswith(MAGIC + bytes([HEADER]))
    return profile.decode(errors="replace") if is_mcap else None


def is_other_mcap(path: Path) -> bool:
    """True for an MCAP file with a profile other than those of ROS."""
    return mcap_profile(path) not in (None, "ros1", "ros2")


def describe_mcap(path: Path | str) -> dict[str, Any]:
    """Return type and number of messages of each topic, and when they were written."""
    with parsing(path, "an MCAP file"), open_file(Path(path)) as opened:
        file = McapFile(opened, Path(path).name)
    rows = [
        {
            "topic": channel.topic,
            "type": getattr(file.schemas.get(channel.schema_id), "name", ""),
            "messages": file.counts[number],
        }
        for number, channel in file.channels.items()
    ]
    first, last = file.span_ns
    span = {"first_s": 1e-9 * first, "last_s": 1e-9 * last}
    return {"mcap": str(path), "topics": rows, **span, "notes": [*file.notes]}
