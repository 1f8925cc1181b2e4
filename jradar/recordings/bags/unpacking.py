"""Compressed parts of bags, unpacked to a limited size.

The package rosbags unpacks a chunk as a whole, however large it becomes: a few
kilobytes can hold gigabytes of zeros. `limit_rosbags` gives it functions that stop.
"""

import bz2
import functools
from typing import Any, NamedTuple

MOST_BYTES = 256 << 20  # of a chunk; recorders write some megabytes
MOST_RATIO = 100  # of a compressed file; recordings reach 10
LEAST_LIMIT = 1 << 30  # bytes that any compressed file may unpack to


def unpack(decompressor: Any, data: bytes) -> bytes:
    """Return the unpacked data; ValueError beyond `MOST_BYTES` and for a cut chunk."""
    unpacked = decompressor.decompress(data, MOST_BYTES + 1)
    if len(unpacked) > MOST_BYTES:
        raise ValueError(f"a chunk unpacks to more than {MOST_BYTES:,} bytes")
    if not decompressor.eof:
        raise ValueError("a chunk ends before its data")
    return unpacked


class LimitedZstd(NamedTuple):
    """The two functions of a zstd module that rosbags uses, with limits."""

    module: Any

    def decompress(self, data: bytes) -> bytes:
        """Return an unpacked message."""
        return unpack(self.module.ZstdDecompressor(), data)

    def open(self, file: Any, mode: str) -> Any:
        """Return a file that unpacks `file`, an open compressed file, to a limit."""
        packed = file.seek(0, 2)
        file.seek(0)
        limit = max(MOST_RATIO * packed, LEAST_LIMIT)
        return _LimitedFile(self.module.open(file, mode), limit)


class _LimitedFile:
    """A file for reading that ends with ValueError after `limit` bytes."""

    def __init__(self, file: Any, limit: int):
        self._file, self._left, self._limit = file, limit, limit

    def __enter__(self) -> "_LimitedFile":
        return self

    def __exit__(self, *_: Any) -> None:
        self._file.close()

    def read(self, size: int) -> bytes:
        """Return the next bytes."""
        data = self._file.read(size)
        self._left -= len(data)
        if self._left < 0:
            raise ValueError(f"a file unpacks to more than {self._limit:,} bytes")
        return data


@functools.cache
def limit_rosbags() -> None:
    """Let rosbags unpack nothing beyond the limits, for the whole process."""
    from lz4.frame import LZ4FrameDecompressor
    from rosbags.rosbag1 import reader as bag1
    from rosbags.rosbag2 import reader as bag2, storage_mcap as mcap

    zstd: Any = bag2.zstd
    bag1.decompressors["bz2"] = lambda data: unpack(bz2.BZ2Decompressor(), data)
    bag1.decompressors["lz4"] = lambda data: unpack(LZ4FrameDecompressor(), data)
    mcap.DECOMPRESSORS["lz4"] = lambda data, _: unpack(LZ4FrameDecompressor(), data)
    mcap.DECOMPRESSORS["zstd"] = lambda data, _: unpack(zstd.ZstdDecompressor(), data)
    setattr(bag2, "zstd", LimitedZstd(zstd))  # noqa: B010  a module of the package
