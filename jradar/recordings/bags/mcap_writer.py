"""MCAP files that a killed program and a full disk leave readable.

The package `mcap` makes every record. It hands them to Python's buffers; how they reach
the disk is ours:

    header | chunk, index | chunk, index | end        complete: any reader opens it
    header | chunk, index | chunk, index | chunk      the next chunk goes over the end

A chunk goes to the system as a whole. What does not fit on the disk is cut off, and the
file ends with what came before and an end without an index, which readers scan.
"""

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from jradar.errors import UsageError, optional

MAGIC = b"\x89MCAP0\r\n"
# Two records, the end of the data and a footer that names no summary, and MAGIC.
END_WITHOUT_INDEX = (
    *(b"\x0f", (4).to_bytes(8, "little"), bytes(4)),
    *(b"\x02", (20).to_bytes(8, "little"), bytes(20), MAGIC),
)


class Schema(NamedTuple):
    """The type of a topic's messages, and how both are written down."""

    name: str
    definition: bytes
    encoding: str = "ros2msg"  # of the definition
    messages: str = "cdr"  # encoding of the messages
    metadata: dict[str, str] = {}  # of the topic


class McapWriter:
    """A new file; the end of a `with` block closes it.

    Errors of the disk are OSErrors that name the file. It takes nothing more after one.
    """

    def __init__(self, path: Path, *, profile: str = "ros2", compress: bool = False):
        """Create the file; UsageError if it exists, ImportError without `mcap`."""
        need = f"{path.name} needs mcap"
        self._mcap = optional("mcap.writer", need=need, extra="ros")
        self._file, self._channels = _File(path), dict[str, int]()
        self._schemas = dict[tuple[str, str, bytes], int]()
        kinds = self._mcap.CompressionType
        self._writer = self._mcap.Writer(
            self._file,
            compression=kinds.ZSTD if compress else kinds.NONE,
            use_summary_offsets=False,  # which would grow with every end
        )
        self._writer.start(profile, "jradar")
        self._file.flush()
        self._complete = False

    def __enter__(self) -> "McapWriter":
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def add(self, topic: str, schema: Schema) -> None:
        """Add a topic."""
        described = schema.name, schema.encoding, schema.definition
        if (number := self._schemas.get(described)) is None:
            number = self._writer.register_schema(*described)
            self._schemas[described] = number
        self._channels[topic] = self._writer.register_channel(
            topic, schema.messages, number, schema.metadata
        )

    def write(self, topic: str, time_ns: int, data: bytes | memoryview) -> None:
        """Add a message, with the time of its recording; `flush` makes it safe.

        A chunk that is full is flushed by itself.
        """
        if self._file.failed:
            raise OSError(f"{self._file.path} took nothing more after an error")
        self._writer.add_message(self._channels[topic], time_ns, data, time_ns)
        self._file.flush()
        self._complete = False

    def flush(self) -> None:
        """Hand what was written to the system, from where no crash of ours takes it."""
        self._writer.flush()

    def complete(self) -> None:
        """Make the file whole, with its index; more can be written after that."""
        if not self._complete and not self._file.failed:
            self._writer.flush()
            self._writer.finish()
            self._file.end()
            self._complete = True

    def close(self) -> None:
        """Make the file whole, and close it."""
        try:
            self.complete()
        finally:
            self._file.close()


class _File:
    """What the package writes to: bytes wait until they reach the disk together."""

    def __init__(self, path: Path):
        self.path, self.failed = path, False
        try:
            self._file = path.open("xb", buffering=0)
        except FileExistsError:
            raise UsageError(
                f"{path} exists, and recordings are never overwritten: name another"
            ) from None
        self._waiting, self._size = list[bytes](), 0
        self._kept, self._ended = 0, False  # bytes that stay; whether an end follows

    def write(self, data: bytes) -> None:
        """Let bytes wait."""
        self._waiting.append(data)
        self._size += len(data)

    def tell(self) -> int:
        """Return where the next bytes will be in the file."""
        return self._kept + self._size

    def flush(self) -> None:
        """Write what waits, over an end."""
        size = self._size
        if size:
            self._put()
            self._kept, self._ended = self._kept + size, False

    def end(self) -> None:
        """Write what waits as an end, which the next bytes go over."""
        self._put()
        self._ended = True

    def close(self) -> None:
        """Close the file; what waits is lost."""
        self._file.close()

    def _put(self) -> None:
        waiting, self._waiting, self._size = self._waiting, [], 0
        try:
            if self._ended:
                self._cut()
            self._write(waiting)
        except OSError as error:
            self.failed = True
            with contextlib.suppress(OSError):
                self._cut()
                self._write(END_WITHOUT_INDEX)
            raise OSError(
                f"{self.path} cannot be written ({error}): is the disk full?"
            ) from error

    def _cut(self) -> None:
        self._file.truncate(self._kept)
        self._file.seek(self._kept)

    def _write(self, parts: Sequence[bytes]) -> None:
        for part in parts:
            left = memoryview(part)
            while left:
                left = left[self._file.write(left) or 0 :]
