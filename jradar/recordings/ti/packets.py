"""Packets of a DCA1000 capture card: the place of each byte in the sample stream.

    sequence number u32 | [length u32] | byte count u48 | at most 1456 bytes of samples

The card numbers its packets from 1. The byte count is the number of bytes sent before:
the place of the packet's samples in the stream. Packets may therefore arrive in any
order or twice, and a lost packet leaves a hole of known size. Files of TI's tools
contain the length (14 bytes of header), the network stream does not (10). Frames begin
and end anywhere in a packet. Files are read in pieces of a few megabytes.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Int, UInt8

PAYLOAD = 1456  # bytes of samples in a full packet
HEADER_BYTES = (14, 10)
PIECE = 4096  # packets read together
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
    """Runs of packets that are consecutive both in the files and in the stream.

    All packets of a run hold the same number of bytes. Runs are sorted by `start`.
    """

    files: Files
    header_bytes: int
    start: Int[np.ndarray, " run"]  # in the stream
    offset: Int[np.ndarray, " run"]  # in the files, of the first header
    payload: Int[np.ndarray, " run"]  # bytes of samples in each packet
    number: Int[np.ndarray, " run"]  # of packets

    @property
    def end(self) -> Int[np.ndarray, " run"]:
        """The largest end of each run and those before it, in the stream."""
        return np.maximum.accumulate(self.start + self.payload * self.number)

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
        runs = np.stack([column[first:last] for column in self[2:]], -1)
        for begin, offset, payload, count in runs.tolist():
            record = self.header_bytes + payload
            low = max(start - begin, 0) // payload
            high = min(-((begin - stop) // payload), count)
            if low < high:
                raw = self.files.read(offset + low * record, offset + high * record)
                samples = raw.reshape(-1, record)[:, self.header_bytes :].ravel()
                skip = max(start - begin - low * payload, 0)
                at = max(begin - start, 0)
                samples = samples[skip : skip + len(stream) - at]
                stream[at : at + len(samples)] = samples
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
    for size in HEADER_BYTES:
        position, seen, exact = 0, 0, False
        while seen < LOOKED_AT and position + size < files.size:
            sequence, length, count = _header(files, position, size)
            if not _plausible(sequence, length, count):
                break
            exact |= count == (sequence - 1) * PAYLOAD
            position, seen = position + size + length, seen + 1
        if exact and (seen > 1 or position + size >= files.size):
            return size
    return 0


def index_packets(files: Files, header_bytes: int, *, allow_partial: bool) -> Packets:
    """Return the index of all packets in the files; only headers are used.

    Raises ValueError for a damaged header, for a stream that restarts, for a stream
    that is mostly lost, and for a truncated last packet unless `allow_partial` is set.
    """
    runs, position, highest, received, window = [], 0, 0, 0, 1
    while position < files.size:
        found = _runs_at(files, position, header_bytes, window)
        for start, offset, payload, count in found:
            if start < highest - REORDERED:
                raise ValueError(
                    f"{_place(files, offset)}: the byte count falls from {highest:,} "
                    f"to {start:,}: if the file holds two captures, split it"
                )
            highest = max(highest, start + payload * count)
            received += payload * count
            position = offset + (header_bytes + payload) * count
        if not found:
            if allow_partial:
                break
            raise ValueError(
                f"{files.paths[-1]} ends within a packet, after {files.size:,} bytes: "
                "truncated? --allow-partial reads the packets before it"
            )
        window = min(2 * window, PIECE) if found[-1][2] == PAYLOAD else 1
        runs += found
    if not runs or highest > 2 * received + REORDERED:
        raise ValueError(
            f"{files.paths[0]}: the packets hold {received:,} bytes of the {highest:,} "
            "that their headers count: a header is damaged, or most packets were lost"
        )
    start, offset, payload, count = np.array(sorted(runs), np.int64).T
    return Packets(files, header_bytes, start, offset, payload, count)


def _runs_at(files, position, header_bytes, window):
    """Return runs `(start, offset, payload, count)` of the packets at `position`.

    Reads up to `window` full packets, or one shorter packet. Returns no runs if that
    packet is truncated.
    """
    record = header_bytes + PAYLOAD
    piece = files.read(position, position + window * record)
    whole = piece[: len(piece) // record * record].reshape(-1, record)
    sequence, length, count = _fields(whole[:, :header_bytes])
    fits = _plausible(sequence, length, count) & (length == PAYLOAD)
    full = len(whole) if fits.all() else int(fits.argmin())
    if not full:
        if len(piece) < header_bytes + 1:
            return []
        sequence, length, count = _header(files, position, header_bytes)
        if not _plausible(sequence, length, count):
            hint = ", or the packet before not full" if header_bytes == 10 else ""
            raise ValueError(
                f"{_place(files, position)}: expected the header of a packet, found "
                f"number {sequence} with {length} bytes after {count:,}: damaged{hint}?"
            )
        cut = position + header_bytes + length > files.size
        return [] if cut else [(count, position, length, 1)]
    breaks = np.flatnonzero(np.diff(count[:full]) != PAYLOAD) + 1
    edges = [0, *breaks.tolist(), full]
    return [
        (int(count[low]), position + low * record, PAYLOAD, high - low)
        for low, high in zip(edges, edges[1:], strict=False)
    ]


def _header(files, position, header_bytes):
    """Return sequence number, length and byte count of the packet at `position`.

    Packets without a length are full, except the last one.
    """
    header = files.read(position, position + header_bytes)
    sequence, length, count = (int(field[0]) for field in _fields(header[None]))
    if header_bytes == 10:
        length = min(PAYLOAD, files.size - position - header_bytes)
    return sequence, length, count


def _fields(headers):
    """Return the same fields of headers `[packet, byte]`, all of full packets."""
    widths = [4, 4, 6] if headers.shape[1] == 14 else [4, 6]
    parts = np.split(headers.astype(np.int64), np.cumsum(widths)[:-1], axis=1)
    fields = [part @ 256 ** np.arange(part.shape[1]) for part in parts]
    if len(fields) == 2:
        fields.insert(1, np.full(len(headers), PAYLOAD))
    return fields


def _plausible(sequence, length, count):
    """True where the packets before number `sequence` can have held `count` bytes."""
    most = (sequence - 1) * PAYLOAD
    counts = (count >= (sequence > 1)) & (count <= most)
    return (sequence > 0) & (length > 0) & (length <= PAYLOAD) & counts


def _place(files, position):
    file = int(np.searchsorted(files.ends, position, "right"))
    before = int(files.ends[file - 1]) if file else 0
    return f"{files.paths[file]}, byte {position - before:,}"
