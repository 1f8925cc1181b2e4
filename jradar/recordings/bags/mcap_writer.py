"""MCAP files that stay readable after a crash, and when the disk is full.

The package `mcap` makes every record. Our own code writes them to the disk, because the
package writes to a buffer, in pieces, and can write only one end:

    header | chunk, index | chunk, index | end       whole: any reader opens it
    header | chunk, index | chunk, index | chunk     the next chunk replaces the end

Topics and their types are also written outside of chunks, and in the index, so that a
damaged chunk costs its own messages alone. A chunk reaches the system as a whole. If it
does not fit on the disk, it is cut off. The file then has the chunks before it and an
end without an index: readers scan it.
"""

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from jradar.errors import UsageError, optional

# The end of the data, a footer that names no summary, and the magic bytes.
END_WITHOUT_INDEX = (
    *(b"\x0f", (4).to_bytes(8, "little"), bytes(4)),
    *(b"\x02", (20).to_bytes(8, "little"), bytes(20), b"\x89MCAP0\r\n"),
)


class Schema(NamedTuple):
    """The type of a topic's messages, and how both are encoded."""

    name: str
    definition: bytes
    encoding: str = "ros2msg"  # of the definition
    messages: str = "cdr"  # encoding of the messages
    metadata: dict[str, str] = {}  # of the topic


class McapWriter:
    """A new file; the end of a `with` block closes it.

    Errors of the disk are OSErrors that name the file, which takes nothing after one.
    """

    def __init__(self, path: Path, *, profile: str = "ros2", compress: bool = False):
        """Create the file; UsageError if it exists, ImportError without `mcap`."""
        need = {"need": f"{path.name} needs mcap", "extra": "ros"}
        mcap = optional("mcap.writer", **need)
        self._records = optional("mcap.records", **need)
        self._builder = optional("mcap.data_stream", **need).RecordBuilder
        kind = mcap.CompressionType.ZSTD if compress else mcap.CompressionType.NONE
        self._file, self._complete = _File(path), False
        self._writer = mcap.Writer(
            self._file,
            compression=kind,
            use_summary_offsets=False,  # which would grow with every end
        )
        self._writer.start(profile, "jradar")
        self._file.flush()
        self.topics = dict[str, int]()  # numbers of channels

    def __enter__(self) -> "McapWriter":
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def add(self, topic: str, schema: Schema) -> None:
        """Add a topic."""
        kind, written = self._records, self._builder()
        name, encoding, text = schema.name, schema.encoding, schema.definition
        number = self._writer.register_schema(name, encoding, text)
        kind.Schema(number, text, encoding, name).write(written)
        described: Any = {"topic": topic, "message_encoding": schema.messages}
        described |= {"schema_id": number, "metadata": schema.metadata}
        self.topics[topic] = self._writer.register_channel(**described)
        kind.Channel(id=self.topics[topic], **described).write(written)
        self._file.write(written.end())

    def write(self, topic: str, time_ns: int, data: bytes | memoryview) -> None:
        """Add a message, with the time of its recording.

        It is safe after `flush`, and as soon as its chunk is full.
        """
        self._writer.add_message(self.topics[topic], time_ns, data, time_ns)
        self._complete = False
        self._file.flush()

    def flush(self) -> None:
        """End the chunk, and hand it to the system."""
        self._writer.flush()

    def complete(self) -> None:
        """Make the file whole, with its index; more messages can follow."""
        if not self._complete and not self._file.failed:
            self._writer.flush()
            self._writer.finish()
            self._file.flush(ends=True)
            self._complete = True

    def close(self) -> None:
        """Make the file whole, and close it."""
        try:
            self.complete()
        finally:
            self._file.close()


class _File:
    """The file to which the package writes; bytes wait, and reach the disk together."""

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
        self.close = self._file.close

    def write(self, data: bytes) -> None:
        """Let bytes wait."""
        self._waiting.append(data)
        self._size += len(data)

    def tell(self) -> int:
        """Return where the next bytes will be in the file."""
        return self._kept + self._size

    def flush(self, *, ends: bool = False) -> None:
        """Write what waits, in place of an earlier end; `ends` says that it is an end.

        Raises OSError that names the file if it does not fit.
        """
        waiting, size, self._waiting, self._size = self._waiting, self._size, [], 0
        if not size:
            return
        if self.failed:
            raise OSError(f"{self.path} cannot be written after an error")
        try:
            self._put(waiting)
        except OSError as error:
            self.failed = True
            with contextlib.suppress(OSError):
                self._put(END_WITHOUT_INDEX)
            raise OSError(
                f"{self.path} cannot be written ({error}): is the disk full?"
            ) from error
        self._ended = ends
        self._kept += 0 if ends else size

    def _put(self, parts: Sequence[bytes]) -> None:
        if self._ended or self.failed:
            self._file.truncate(self._kept)
            self._file.seek(self._kept)
        for part in parts:
            left = memoryview(part)
            while left:
                left = left[self._file.write(left) or 0 :]
