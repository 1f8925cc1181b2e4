"""Packets of a DCA1000 capture card: the place of each byte in the sample stream.

    sequence number u32 | [length u32] | byte count u48 | at most 1456 bytes of samples

The card numbers its packets from 1. The byte count is the number of bytes sent before:
the place of the packet's samples in the stream. Packets may therefore arrive in any
order or twice, and a lost packet leaves a hole of known size. Files of TI's tools
contain the length (14 bytes of header), the network stream does not (10). Frames begin
and end anywhere in a packet. Files are read in pieces of a few megabytes.
"""

import array
import itertools
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Int, UInt8

PAYLOAD = 1456  # bytes of samples in a full packet
HEADERS = {14: struct.Struct("<IIIH"), 10: struct.Struct("<IIH")}
PIECE = 4 << 20  # bytes read together
REORDERED = 64 << 20  # bytes by which a packet may be late
LOOKED_AT = 16  # packets that decide whether a file consists of packets


class Files(NamedTuple):
    """The parts of a split file, read as one."""

    paths: tuple[Path, ...]
    ends: Int[np.ndarray, " file"]  # cumulative bytes after each file

    @classmethod
    def of(cls, paths: list[Path]) -> "Files":
        """Return the files in the order of `paths` with their present sizes."""
        sizes = np.array([path.stat().st_size for path in paths], np.int64)
        return cls(tuple(paths), np.cumsum(sizes))

    @property
    def size(self) -> int:
        """Number of bytes of all files."""
        return int(self.ends[-1])

    def read(self, start: int, stop: int) -> UInt8[np.ndarray, " byte"]:
        """Return bytes `start` to `stop`, fewer at the end of the last file."""
        parts, begin = [np.empty(0, np.uint8)], 0
        for path, end in zip(self.paths, self.ends.tolist(), strict=True):
            if (count := min(stop, end) - start) > 0:
                part = np.fromfile(path, np.uint8, count, offset=start - begin)
                if len(part) < count:
                    raise ValueError(f"{path} was truncated while it was read")
                parts.append(part)
                start += count
            begin = end
        return np.concatenate(parts)


class Packets(NamedTuple):
    """Where the samples of each packet lie, sorted by their places in the stream."""

    files: Files
    start: Int[np.ndarray, " packet"]  # in the stream
    offset: Int[np.ndarray, " packet"]  # in the files
    sizes: Int[np.ndarray, " packet"]  # bytes of samples

    @classmethod
    def of(
        cls, files: Files, start: np.ndarray, offset: np.ndarray, sizes: np.ndarray
    ) -> "Packets":
        """Return packets in any order; ValueError if most of the stream is missing."""
        highest, received = int((start + sizes).max(initial=0)), int(sizes.sum())
        if not received or highest > 2 * received + REORDERED:
            raise ValueError(
                f"{files.paths[0]}: the packets hold {received:,} bytes of the "
                f"{highest:,} that their headers count: a header is damaged, or most "
                "packets were lost"
            )
        order = np.argsort(start, kind="stable")
        return cls(files, start[order], offset[order], sizes[order])

    @property
    def end(self) -> Int[np.ndarray, " packet"]:
        """The largest end of each packet and those before it, in the stream."""
        return np.maximum.accumulate(self.start + self.sizes)

    @property
    def size(self) -> int:
        """Number of bytes of the stream, including lost ones."""
        return int(self.end[-1])

    def holes(self) -> tuple[Int[np.ndarray, " hole"], Int[np.ndarray, " hole"]]:
        """Return the first lost byte of each hole in the stream, and the end."""
        before = np.append(0, self.end[:-1])
        lost = self.start > before
        return before[lost], self.start[lost]

    def read(self, start: int, stop: int) -> UInt8[np.ndarray, " byte"]:
        """Return bytes of the stream, with zeros for lost ones."""
        stream = np.zeros(stop - start, np.uint8)
        first = np.searchsorted(self.end, start, "right")
        last = np.searchsorted(self.start, stop)
        table = np.stack([column[first:last] for column in self[1:]], -1)
        if not len(table):
            return stream
        low = int(table[:, 1].min())
        raw = self.files.read(low, int((table[:, 1] + table[:, 2]).max()))
        for place, offset, size in (table - [start, low, 0]).tolist():
            begin, end = max(place, 0), min(place + size, len(stream))
            stream[begin:end] = raw[offset + begin - place : offset + end - place]
        return stream


def lost_per_frame(
    packets: Packets, frame_bytes: int, num_frames: int
) -> Int[np.ndarray, " frame"]:
    """Return the number of lost bytes of each frame."""
    first, last = packets.holes()
    places = np.append(np.stack([first, last], -1).ravel(), packets.size)
    lost = np.cumsum(np.append(0, last - first))
    edges = np.arange(num_frames + 1) * frame_bytes
    so_far = np.interp(edges, np.append(0, places), np.repeat(lost, 2))
    return np.diff(np.rint(so_far).astype(np.int64))


def header_size(files: Files) -> int:
    """Return 14 or 10 if the files consist of packets with such headers, else 0.

    The first packets decide. At least two (or the only one) need plausible counts, one
    of them the exact count that full packets give.
    """
    for size in HEADERS:
        seen, end, exact = 0, 0, False
        for place, *header in itertools.islice(_headers(files, size), LOOKED_AT):
            number, length, count = header
            if not _plausible(*header):
                break
            exact |= count == (number - 1) * PAYLOAD
            seen, end = seen + 1, place + size + length
        if exact and (seen > 1 or end + size >= files.size):
            return size
    return 0


def index_packets(files: Files, header_bytes: int, *, allow_partial: bool) -> Packets:
    """Return the index of all packets in the files; only headers are used.

    Raises ValueError for a damaged header, for a stream that restarts, for a stream
    that is mostly lost, and for a truncated last packet unless `allow_partial` is set.
    """
    rows, end, highest = array.array("q"), 0, 0
    for place, number, length, count in _headers(files, header_bytes):
        start, end = place + header_bytes, place + header_bytes + length
        if not _plausible(number, length, count):
            hint = ", or the packet before not full" if header_bytes == 10 else ""
            raise ValueError(
                f"{_place(files, place)}: expected the header of a packet, found "
                f"number {number} with {length} bytes after {count:,}: damaged{hint}?"
            )
        if end > files.size:
            break
        if count < highest - REORDERED:
            raise ValueError(
                f"{_place(files, place)}: the byte count falls from {highest:,} to "
                f"{count:,}: if the file holds two captures, split it"
            )
        highest = max(highest, count + length)
        rows.extend((count, start, length))
    if end != files.size and not allow_partial:
        raise ValueError(
            f"{files.paths[-1]} ends within a packet, after {files.size:,} bytes: "
            "truncated? --allow-partial reads the packets before it"
        )
    return Packets.of(files, *np.array(rows, np.int64).reshape(-1, 3).T)


def _headers(files: Files, size: int) -> Iterator[tuple[int, int, int, int]]:
    """Yield place in the files, number, length and byte count of each packet.

    Packets without a length are full, except the last one.
    """
    piece, begin, place = b"", 0, 0
    while place + size < files.size:
        if place + size > begin + len(piece):
            piece, begin = files.read(place, place + PIECE).tobytes(), place
        number, *given, low, high = HEADERS[size].unpack_from(piece, place - begin)
        length = given[0] if given else min(PAYLOAD, files.size - place - size)
        yield place, number, length, high << 32 | low
        place += size + length


def _plausible(sequence, length, count):
    """True if the packets before number `sequence` can have held `count` bytes."""
    counts = (sequence > 1) <= count <= (sequence - 1) * PAYLOAD
    return sequence > 0 and 0 < length <= PAYLOAD and counts


def _place(files, position):
    file = int(np.searchsorted(files.ends, position, "right"))
    before = int(files.ends[file - 1]) if file else 0
    return f"{files.paths[file]}, byte {position - before:,}"
