"""Compressed parts of bags, unpacked to a limited size.

A few kilobytes can hold gigabytes of zeros, so a part is unpacked only as far as the
limit.
"""

import bz2
from pathlib import Path
from typing import Any

from jradar.errors import optional

MOST_BYTES = 256 << 20  # of a chunk; recorders write some megabytes
MOST_RATIO = 100  # of a compressed file; recordings reach 10
LEAST_LIMIT = 1 << 30  # bytes that any compressed file may unpack to
PIECE = 1 << 20


def unpack(compression: str, data: bytes) -> bytes:
    """Return unpacked `data`; ValueError beyond `MOST_BYTES`, or if it is cut off."""
    if compression in ("", "none"):
        return data
    if compression == "bz2":
        decompressor: Any = bz2.BZ2Decompressor()
    elif compression == "lz4":
        from lz4.frame import LZ4FrameDecompressor

        decompressor = LZ4FrameDecompressor()
    elif compression == "zstd":
        decompressor = zstd().ZstdDecompressor()
    else:
        raise ValueError(f"a chunk is compressed by {compression!r}")
    unpacked = decompressor.decompress(data, MOST_BYTES + 1)
    if len(unpacked) > MOST_BYTES:
        raise ValueError(f"a chunk unpacks to more than {MOST_BYTES:,} bytes")
    if not decompressor.eof:
        raise ValueError("a chunk ends before its data")
    return unpacked


def check_file(path: Path) -> None:
    """Raise ValueError for a zstd file that unpacks to too much; others pass."""
    limit = max(MOST_RATIO * path.stat().st_size, LEAST_LIMIT)
    size, module = 0, zstd()
    try:
        with module.open(path) as file:
            while size <= limit and (piece := file.read(PIECE)):
                size += len(piece)
    except (module.ZstdError, EOFError):
        return  # not a zstd file, or a damaged one, which its reader reports
    if size > limit:
        raise ValueError(f"a file unpacks to more than {limit:,} bytes")


def zstd() -> Any:
    """Return Python's zstd module, or its replacement before Python 3.14."""
    reader = "rosbags.rosbag2.reader"
    return optional(reader, need="zstd in bags needs rosbags", extra="ros").zstd
