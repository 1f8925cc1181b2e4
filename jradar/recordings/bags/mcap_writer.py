"""MCAP files of ROS 2 messages, written so that a killed program loses nothing.

Each message is a chunk of its own, without compression, that is handed to the system
when it is complete. The end makes the file quick to open, also for other programs:

    header | chunk, index | chunk, index ..           while it is written, or killed
    .. | schemas, channels, chunks, statistics        the end, written by `close`

The layout is that of mcap.dev/spec. No package is needed.
"""

import contextlib
import os
import struct
import zlib
from pathlib import Path
from typing import NamedTuple

from jradar.errors import UsageError
from jradar.recordings.bags.foxglove import (
    CHANNEL,
    CHUNK,
    CHUNK_INDEX,
    DATA_END,
    FOOTER_RECORD,
    HEADER,
    MAGIC,
    MESSAGE,
    MESSAGE_INDEX,
    SCHEMA,
    STATISTICS,
)


class _Topic(NamedTuple):
    number: int
    described: bytes  # records of schema and channel
    times: list[int]  # of its messages, nanoseconds


class McapWriter:
    """A new file; `close`, or the end of a `with` block, writes its end."""

    def __init__(self, path: Path):
        """Create the file; UsageError if it exists."""
        self.path, self._topics, self._chunks = path, dict[str, _Topic](), list[bytes]()
        try:
            self._file = path.open("xb", buffering=0)
        except FileExistsError:
            raise UsageError(
                f"{path} exists, and recordings are never overwritten: name another"
            ) from None
        self._size = 0  # of what is whole
        self._append(MAGIC + _record(HEADER, _text("ros2") + _text("jradar")))

    def __enter__(self) -> "McapWriter":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def add(self, topic: str, kind: str, definition: str) -> None:
        """Add a topic of messages of a `kind`, which `definition` describes."""
        number = len(self._topics) + 1
        schema = _text(kind) + _text("ros2msg") + _text(definition)
        ids = struct.pack("<HH", number, number)
        described = _record(SCHEMA, struct.pack("<H", number) + schema)
        described += _record(
            CHANNEL, ids + _text(topic) + _text("cdr") + struct.pack("<I", 0)
        )
        self._topics[topic] = _Topic(number, described, [])

    def write(self, topic: str, time_ns: int, *data: bytes | memoryview) -> None:
        """Write a message, whose `data` are joined, with the time of its recording.

        Raises OSError that names the file if it does not fit on the disk. The file then
        ends with the message before.
        """
        number, described, times = self._topics[topic]
        first = b"" if times else described
        head = struct.pack("<HIQQ", number, len(times), time_ns, time_ns)
        size = len(head) + sum(map(len, data))
        message = [first, struct.pack("<BQ", MESSAGE, size), head, *data]
        inside = b"".join(message)
        span = struct.pack("<QQQ", time_ns, time_ns, len(inside))
        packed = _text("") + struct.pack("<Q", len(inside))
        check = struct.pack("<I", zlib.crc32(inside))
        start, index = self._size, struct.pack("<HIQQ", number, 16, time_ns, len(first))
        chunk = _record(CHUNK, span + check + packed + inside)
        end = start + len(chunk)
        indexed = _record(MESSAGE_INDEX, index)
        self._append(chunk + indexed)
        times.append(time_ns)
        self._chunks.append(
            struct.pack("<QQQQ", time_ns, time_ns, start, end - start)
            + struct.pack("<IHQQ", 10, number, end, len(indexed))
            + packed
            + struct.pack("<Q", len(inside))
        )

    def close(self) -> None:
        """Write the end of the file; a full disk leaves it without."""
        if self._file.closed:
            return
        times = [time for topic in self._topics.values() for time in topic.times]
        counts = b"".join(
            struct.pack("<HQ", topic.number, len(topic.times))
            for topic in self._topics.values()
        )
        span = min(times, default=0), max(times, default=0)
        topics, chunks = len(self._topics), len(self._chunks)
        numbers = (len(times), topics, topics, 0, 0, chunks, *span, len(counts))
        statistics = struct.pack("<QHIIIIQQI", *numbers) + counts
        data_end = _record(DATA_END, struct.pack("<I", 0))
        start = self._size + len(data_end)
        end = [
            data_end,
            *(topic.described for topic in self._topics.values()),
            *(_record(CHUNK_INDEX, chunk) for chunk in self._chunks),
            _record(STATISTICS, statistics),
            _record(FOOTER_RECORD, struct.pack("<QQI", start, 0, 0)),
            MAGIC,
        ]
        try:
            self._append(b"".join(end))
        finally:
            self._file.close()

    def _append(self, data: bytes) -> None:
        left = memoryview(data)
        try:
            while left:
                left = left[self._file.write(left) or 0 :]
        except OSError as error:
            with contextlib.suppress(OSError):
                self._file.truncate(self._size)
                self._file.seek(0, os.SEEK_END)
            raise OSError(
                f"{self.path} cannot be written ({error}): is the disk full?"
            ) from error
        self._size += len(data)


def _record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


def _text(text: str) -> bytes:
    data = text.encode()
    return struct.pack("<I", len(data)) + data
