"""What an MCAP file holds that is not a ROS 2 bag, such as `jradar enhance -o x.mcap`.

Its summary, between the messages and the footer, lists topics and counts:

    .. messages | schemas, channels, statistics | footer
                ^ summary_start
"""

import io
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from jradar.errors import parsing
from jradar.files import open_file

MAGIC = b"\x89MCAP0\r\n"
FOOTER = struct.Struct("<BQQQI8s")  # operation, length, summary, offsets, sum, MAGIC
HEADER, FOOTER_RECORD, SCHEMA, CHANNEL, MESSAGE = 0x01, 0x02, 0x03, 0x04, 0x05
CHUNK, MESSAGE_INDEX, CHUNK_INDEX = 0x06, 0x07, 0x08
STATISTICS, DATA_END = 0x0B, 0x0F
MOST_BYTES = 64 << 20  # of a summary


def is_other_mcap(path: Path) -> bool:
    """Whether a file is an MCAP file of another profile than ROS 2's."""
    if path.suffix != ".mcap" or not path.is_file():
        return False
    with open_file(path) as file:
        begin = io.BytesIO(file.read(1024))
    if begin.read(8) != MAGIC or begin.read(1)[:1] != bytes([HEADER]):
        return False
    begin.seek(8, io.SEEK_CUR)
    return _text(begin) not in ("ros1", "ros2")


def describe_mcap(path: Path | str) -> dict[str, Any]:
    """Return type and number of messages of each topic, and when they were written.

    Raises ValueError for a file that was cut off.
    """
    schemas: dict[int, str] = {}
    channels: dict[int, tuple[str, int]] = {}
    counts: dict[int, int] = {}
    span: dict[str, float] = {}
    with parsing(path, "a whole MCAP file"):
        for kind, record in _summary(Path(path)):
            if kind == SCHEMA:
                (number,) = struct.unpack("<H", record.read(2))
                schemas[number] = _text(record)
            elif kind == CHANNEL:
                number, schema = struct.unpack("<HH", record.read(4))
                channels[number] = _text(record), schema
            elif kind == STATISTICS:
                *_, first, last, size = struct.unpack("<QHIIIIQQI", record.read(46))
                counts = dict(struct.iter_unpack("<HQ", record.read(size)))
                span = {"first_s": 1e-9 * first, "last_s": 1e-9 * last}
    rows = [
        {"topic": topic, "type": schemas.get(schema, ""), "messages": counts.get(n, 0)}
        for n, (topic, schema) in channels.items()
    ]
    return {"mcap": str(path), "topics": rows, **span}


def _summary(path: Path) -> Iterator[tuple[int, io.BytesIO]]:
    """Yield kind and content of each record of a file's summary."""
    with open_file(path) as file:
        end = file.seek(-FOOTER.size, io.SEEK_END)
        *_, start, _, _, magic = FOOTER.unpack(file.read())
        if magic != MAGIC or not 0 < start <= end or end - start > MOST_BYTES:
            raise ValueError("it has no summary: it was cut off")
        file.seek(start)
        summary = io.BytesIO(file.read(end - start))
    while head := summary.read(9):
        kind, size = struct.unpack("<BQ", head)
        yield kind, io.BytesIO(summary.read(size))


def _text(record: io.BytesIO) -> str:
    (size,) = struct.unpack("<I", record.read(4))
    return record.read(size).decode()
