"""The stream that TI's demos send over the data port, parsed as its bytes arrive.

    magic 02 01 04 03 06 05 08 07 | 8 words: version, length of the packet, platform,
    frame, CPU cycles, objects, TLVs, sub-frame | type, length, payload of each TLV |
    padding to 32 bytes

A stream may begin and end anywhere, and lose bytes anywhere: what is not a packet is
counted as lost, and the next magic begins a packet. A packet that lacks its last byte,
of the padding or of the last noise, is whole: some loggers write them so.

Points are TLVs of type 1: float32 x, y, z, Doppler of mmWave SDK 3 and 4, or the
integers of SDK 1 and 2. Type 7 holds their SNR and noise in tenths of dB.
"""

import struct
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

MAGIC = bytes((2, 1, 4, 3, 6, 5, 8, 7))
WORDS = struct.Struct("<8I")
HEADER_BYTES = len(MAGIC) + WORDS.size
PART = struct.Struct("<II")  # the head of a TLV
MOST_BYTES = 1 << 19  # of a packet; range-azimuth heatmaps take some 100 kB
MOST_PARTS, MOST_KIND = 64, 0xFFFF
SHORT = 1  # bytes that may be missing at the end of a packet
POINTS, SIDE_INFO = 1, 7
POINT = np.dtype([(name, "<f4") for name in ("x", "y", "z", "doppler")])
SIDE = np.dtype([("snr", "<i2"), ("noise", "<i2")])
OLD_POINT = np.dtype(
    [("range_index", "<u2"), ("doppler_index", "<i2"), ("peak", "<u2")]
    + [(name, "<i2") for name in "xyz"]
)
OTHER_POINTS = {  # which only other demos send
    301: "compressed points of the xWRL demos",
    1000: "spherical points of people counting",
    1010: "tracks of people counting",
    1020: "compressed points of people tracking",
}
FORWARD, DECIBELS = "y", ("snr",)  # of the `Layout`: x right, z up; peaks are linear


class Packet(NamedTuple):
    """One whole packet: its place in the stream, its arrival, its header, its TLVs."""

    start: int
    size: int
    stamp_s: float | None
    version: int
    platform: int
    frame: int
    cycles: int
    subframe: int
    parts: tuple[tuple[int, bytes], ...]

    @property
    def is_old(self) -> bool:
        """Whether points are the integers of mmWave SDK 1 and 2."""
        return self.version >> 24 < 3

    @property
    def sdk(self) -> str:
        """Version of the demo, such as "3.6.0.0"."""
        return ".".join(f"{byte:x}" for byte in self.version.to_bytes(4, "big"))


class Parser:
    """Packets of a stream whose bytes arrive piece by piece."""

    def __init__(self):
        """Wait for the first packet."""
        self.lost_bytes = 0  # which belong to no packet
        self.packets = 0
        self._bytes, self._at = bytearray(), 0  # what waits, and its place
        self._stamps: list[tuple[int, float | None]] = []  # of pieces, by their places

    def feed(self, data: bytes, *, stamp_s: float | None = None) -> list[Packet]:
        """Return the packets that `data`, which arrived at `stamp_s`, completes."""
        self._stamps.append((self._at + len(self._bytes), stamp_s))
        self._bytes += data
        return [*self._whole(ends=False)]

    def finish(self) -> list[Packet]:
        """Return the last packet if only its padding is missing; the stream ends."""
        found = [*self._whole(ends=True)]
        self._drop(len(self._bytes), lost=True)
        return found

    def _whole(self, *, ends: bool) -> Iterator[Packet]:
        while (begin := self._bytes.find(MAGIC)) >= 0:
            self._drop(begin, lost=True)
            if len(self._bytes) < HEADER_BYTES:
                return
            words = WORDS.unpack_from(self._bytes, len(MAGIC))
            size, parts = words[1], words[6]
            if not HEADER_BYTES <= size <= MOST_BYTES or parts > MOST_PARTS:
                self._drop(len(MAGIC), lost=True)
                continue
            following = self._bytes.find(MAGIC, len(MAGIC), size + len(MAGIC) - 1)
            if following < 0 and len(self._bytes) < size and not ends:
                return
            end = min(size, len(self._bytes)) if following < 0 else following
            found = self._parts(parts, end)
            if found is None or 0 <= following < size - SHORT:
                self._drop(end if following >= 0 else len(MAGIC), lost=True)
                continue
            version, _, platform, frame, cycles, _, _, subframe = words
            head = version, platform, frame, cycles, subframe
            packet = Packet(self._at, end, self._stamps[0][1], *head, found)
            self.packets += 1
            self._drop(end, lost=False)
            yield packet
        if not ends:  # the magic itself may be torn
            self._drop(max(len(self._bytes) - len(MAGIC) + 1, 0), lost=True)

    def _parts(self, count: int, end: int) -> tuple[tuple[int, bytes], ...] | None:
        """Return the TLVs before `end`; None if they do not fit."""
        at, found = HEADER_BYTES, []
        for left in reversed(range(count)):
            if at + PART.size > end:
                return None
            kind, size = PART.unpack_from(self._bytes, at)
            at += PART.size
            short = 0 if left or kind == POINTS else SHORT
            if at + size - short > end or kind > MOST_KIND:
                return None
            payload = bytes(self._bytes[at : min(at + size, end)])
            found.append((kind, payload.ljust(size, b"\0")))
            at += size
        return tuple(found)

    def _drop(self, count: int, *, lost: bool) -> None:
        del self._bytes[:count]
        self._at += count
        self.lost_bytes += count if lost else 0
        while len(self._stamps) > 1 and self._stamps[1][0] <= self._at:
            del self._stamps[0]  # of pieces that are gone


def packet_points(
    packet: Packet, *, velocity_step_mps: float | None = None
) -> dict[str, Float[np.ndarray, " point"]]:
    """Return x, y, z, and doppler (m/s), peak or snr (dB), of the points of a packet.

    `velocity_step_mps` is that of the Doppler indices of SDK 1 and 2, which have no
    velocities without it. Raises ValueError for TLVs of a wrong size, and, as
    `check_demo`, for points of another demo.
    """
    check_demo(packet)
    parts = {POINTS: bytes(4 if packet.is_old else 0), **dict(reversed(packet.parts))}
    if packet.is_old:
        return _old_points(packet, parts[POINTS], velocity_step_mps)
    points = _rows(packet, parts[POINTS], POINT)
    found = {name: points[name] for name in POINT.names or ()}
    if SIDE_INFO in parts and len(parts[SIDE_INFO]) == len(points) * SIDE.itemsize:
        found["snr"] = _rows(packet, parts[SIDE_INFO], SIDE)["snr"] * np.float32(0.1)
    return found


def check_demo(packet: Packet) -> None:
    """Raise ValueError for a packet with points of another kind alone."""
    kinds = [kind for kind, _ in packet.parts]
    other = next((kind for kind in kinds if kind in OTHER_POINTS), None)
    if other is not None and POINTS not in kinds:
        raise ValueError(
            f"frame {packet.frame} holds {OTHER_POINTS[other]}, TLV {other}, expected "
            "TLV 1 of the out-of-box demo"
        )


def no_velocities(packet: Packet, step: float | None) -> tuple[str, ...]:
    """Return a note if the points of such packets have no velocity, else nothing."""
    if not packet.is_old or step is not None:
        return ()
    note = f"mmWave SDK {packet.sdk} sends no velocities but indices"
    return (f"{note}: name the .cfg with --radar",)


def _old_points(
    packet: Packet, payload: bytes, step: float | None
) -> dict[str, np.ndarray]:
    if len(payload) < 4:
        raise ValueError(f"frame {packet.frame}: {len(payload)} bytes of points")
    count, shift = struct.unpack_from("<HH", payload)
    points = _rows(packet, payload[4:], OLD_POINT)
    if len(points) != count or shift > 15:
        raise ValueError(
            f"frame {packet.frame}: {len(points)} points in format Q{shift}, expected "
            f"{count} in Q0 to Q15"
        )
    found = {name: points[name] / np.float32(1 << shift) for name in "xyz"}
    if step is not None:
        found["doppler"] = points["doppler_index"] * np.float32(step)
    return found | {"peak": points["peak"] + np.float32(1)}


def _rows(packet: Packet, payload: bytes, kind: np.dtype) -> Any:
    if len(payload) % kind.itemsize:
        raise ValueError(
            f"frame {packet.frame}: {len(payload)} bytes, expected points of "
            f"{kind.itemsize}"
        )
    return np.frombuffer(payload, kind)
