"""Makes frames of packets, which may arrive in any order.

The byte count of a packet is the place of its samples in the stream.

    packet  | 1 | 2 | 3 |   | 5 | 4 | 5 | 6 | ..      some are lost, late or repeated
    frame   |   0     |     1     |    2    | ..      borders lie anywhere in a packet

A frame is delivered once it is whole, or once a packet `window` bytes beyond its end
has arrived. Its lost bytes are then zeros. Frames are delivered in order. A frame of
which less than half arrived is counted, but not delivered.

A packet belongs to the stream if its two counters agree: since the newest packet, both
must have advanced by about the same number of packets, and by no more than 64. Other
packets are set aside. Four that agree with one another are judged by where they lie:

    behind the stream           The card was started again, and this is a new stream.
    somewhat ahead of it        This is the stream after a gap.
    far ahead of it, or where   A second card has the same address. It is ignored until
    an earlier stream ended     it has sent several frames, and the stream no packet.

All others are ignored and counted.
"""

import dataclasses
import time
from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Int, UInt8

from jradar.recordings.ti.packets import PAYLOAD
from jradar.stream.protocol import BYTES, DATA, MOST_PACKET, SEQUENCES, unpack_header
from jradar.stream.source import ReceivedFrame

WINDOW = 64 * PAYLOAD  # bytes by which a packet may be late
NEAR = 64 * PAYLOAD  # by which a single packet may be ahead
SLACK = 4 * PAYLOAD  # by which the counters may differ after short packets
NEW_STREAM = 4  # packets that make a new stream
FORGOTTEN = 64  # packets of the stream after which others are forgotten
LEAST_SHARE = 0.5  # of a frame's bytes that must have arrived
LONG_GAP = 64  # frames; packets farther ahead may be another card's
GONE = 4  # frames that another card sends before a silent stream ends
SPARE = 4  # buffers that are kept for later frames


@dataclasses.dataclass
class Counts:
    """What happened to packets and frames.

    Every packet is counted once: `packets` is the sum of `placed`, `repeated`, `late`,
    `ignored`, `malformed` and `foreign`, apart from the few that are still set aside.
    """

    packets: int = 0
    placed: int = 0  # brought new bytes
    repeated: int = 0  # brought nothing new
    late: int = 0  # beyond the window, or their frame was gone
    ignored: int = 0  # counters that do not fit the stream, such as a second card's
    malformed: int = 0  # too short or too long
    foreign: int = 0  # from other senders
    frames: int = 0  # delivered
    damaged: int = 0  # delivered with lost bytes
    missing: int = 0  # frames of which nothing arrived, not delivered
    sparse: int = 0  # frames of which less than half arrived, not delivered
    unfinished: int = 0  # frames in which a stream ended, not delivered
    lost_bytes: int = 0  # of damaged, sparse and missing frames
    restarts: int = 0  # new streams after the first

    @property
    def lost_packets(self) -> int:
        """Number of packets that the lost bytes fill."""
        return -(-self.lost_bytes // PAYLOAD)


class _Open:
    """A frame that is not complete: its buffer, and the holes in it."""

    def __init__(self, data: np.ndarray):
        self.data, self.view = data, data.data
        self.holes = [(0, len(data))]
        self.stamp_s = time.time()

    def place(self, start: int, samples: memoryview) -> bool:
        """Put samples at `start`, where there are holes; False if there are none."""
        stop, kept, fresh = start + len(samples), [], False
        for low, high in self.holes:
            begin, end = max(low, start), min(high, stop)
            if begin >= end:
                kept.append((low, high))
                continue
            fresh = True
            self.view[begin:end] = samples[begin - start : end - start]
            if low < begin:
                kept.append((low, begin))
            if end < high:
                kept.append((end, high))
        self.holes = kept
        return fresh

    def zero_holes(self) -> int:
        """Set lost bytes to zero; return their number."""
        for low, high in self.holes:
            self.data[low:high] = 0
        return sum(high - low for low, high in self.holes)


class Assembler:
    """Frames of `frame_bytes` from the packets of one card."""

    def __init__(
        self,
        frame_bytes: int,
        deliver: Callable[[ReceivedFrame], None],
        *,
        window: int = WINDOW,
    ):
        """`deliver` is called with each frame; `window` is in bytes."""
        if frame_bytes < 1 or window < 0:
            raise ValueError(
                f"{frame_bytes=}, {window=}, expected a frame of 1 byte or more and "
                "a window of 0 or more"
            )
        self.frame_bytes, self.window, self.counts = frame_bytes, window, Counts()
        self._deliver = deliver
        self._spare: list[np.ndarray] = []
        self._open: dict[int, _Open] = {}
        self._aside: dict[tuple[int, int], tuple[bytes, bool]] = {}
        self._left: tuple[int, int] | None = None  # last counters of another stream
        self._since = 0  # packets of the stream since the last one was set aside
        self._others = 0  # packets of a second card since the last one of the stream
        self._gone = GONE * frame_bytes // PAYLOAD + FORGOTTEN
        self._delivered: int | None = None  # number of the last frame
        self._started = False

    def add(self, packet: bytes | memoryview) -> None:
        """Take one packet of the card."""
        self.counts.packets += 1
        if not DATA.size < len(packet) <= MOST_PACKET:
            self.counts.malformed += 1
            return
        sequence, place = unpack_header(packet)
        if not self._started:
            self._begin(sequence, place)
        moved = _moved(sequence, place, *self._newest)
        late = moved is not None and moved < 0
        near = moved is not None and -self.window <= moved <= NEAR
        if moved is None or not near or self._position + moved < 0:
            self._set_aside(sequence, place, bytes(packet), late=late)
            return
        self._accept(sequence, place, packet, moved)

    def add_all(
        self,
        packets: UInt8[np.ndarray, "packet byte"],
        sizes: Int[np.ndarray, " packet"],
    ) -> None:
        """Take packets of the card, as `add` does one by one; `sizes` are in bytes.

        Packets that follow one another are copied together.
        """
        follows = _follows(packets, sizes)
        index = 0
        while index < len(sizes):
            packet = packets[index].data[: sizes[index]]
            self.add(packet)
            index += 1
            if follows[index] and self._is_newest(packet):
                stop = index + int(follows[index:].argmin())
                self._add_run(packets[index:stop])
                index = stop

    def _is_newest(self, packet: memoryview) -> bool:
        """True if a packet is the newest one, and no other stream is known."""
        alone = self._started and not self._aside and self._left is None
        return alone and unpack_header(packet) == self._newest

    def _add_run(self, packets) -> None:
        """Take whole packets that follow the newest one, which is whole, too."""
        count = len(packets)
        self.counts.packets += count
        self._newest = unpack_header(packets[-1].data)
        self._since += count
        position = self._position + PAYLOAD
        self._position += count * PAYLOAD
        samples = np.ascontiguousarray(packets[:, DATA.size : MOST_PACKET])
        self._place(position, samples.reshape(-1).data, packets=count)

    def _accept(self, sequence, place, packet, moved) -> None:
        """Take a packet of the stream, `moved` bytes from the newest one."""
        position, self._others = self._position + moved, 0
        if moved > 0:
            self._newest, self._position = (sequence, place), position
            self._since += 1
            if self._aside and self._since > FORGOTTEN:
                self._drop_aside()
            if self._left and self._since > self._gone:
                self._left = None
        self._place(position, memoryview(packet)[DATA.size :])

    def flush(self) -> None:
        """Deliver the frames that the stream has passed; drop the one it ended in.

        The next packet begins a new stream.
        """
        self._close(self._end if self._started else 0)
        self.counts.unfinished += len(self._open)
        for frame in self._open.values():
            self.recycle(frame.data)
        self._open.clear()
        self._drop_aside()
        self._started = False

    def recycle(self, data: UInt8[np.ndarray, " byte"]) -> None:
        """Take back the buffer of a frame that is no longer needed."""
        if len(self._spare) < SPARE and len(data) == self.frame_bytes:
            self._spare.append(data)

    def _begin(self, sequence: int, place: int) -> None:
        """Begin a stream. If the card has just started, no frame is missing."""
        self._started, self._newest = True, (sequence, place)
        self._position = self._end = place  # in the stream, without wrapping
        just_started = place <= self.window
        self._first = 0 if just_started else place // self.frame_bytes
        self._next = self._first
        after = -1 if self._delivered is None else self._delivered
        self._base = 0 if self._delivered is None else after + 1 - self._first

    def _place(self, position: int, samples: memoryview, packets: int = 1) -> None:
        """Put samples of packets into their frames, and deliver what is complete."""
        fresh = gone = False
        at, end = position, position + len(samples)
        while at < end:
            number, start = divmod(at, self.frame_bytes)
            part = samples[at - position :][: self.frame_bytes - start]
            at += len(part)
            if number < self._next:
                gone |= number < self._first
                continue
            if number not in self._open:
                data = self._spare.pop() if self._spare else self._buffer()
                self._open[number] = _Open(data)
            fresh |= self._open[number].place(start, part)
        self._end = max(self._end, end)
        if fresh:
            self.counts.placed += packets
        elif gone:
            self.counts.late += 1
        else:
            self.counts.repeated += 1
        self._close(self._position - self.window)

    def _buffer(self) -> np.ndarray:
        return np.empty(self.frame_bytes, np.uint8)

    def _close(self, limit: int) -> None:
        """Deliver in order the frames that are complete, or end before `limit`."""
        for number in sorted(self._open):
            start = number * self.frame_bytes
            holes = self._open[number].holes
            waits = holes and start + self.frame_bytes > limit
            if waits or (number > self._next and start > limit):
                return
            self._finish(number, self._open.pop(number))

    def _finish(self, number: int, frame: _Open) -> None:
        counts, missing = self.counts, number - self._next
        lost = frame.zero_holes()
        counts.missing += missing
        counts.lost_bytes += lost + missing * self.frame_bytes
        self._next, self._delivered = number + 1, self._base + number
        if lost > (1 - LEAST_SHARE) * self.frame_bytes:
            counts.sparse += 1
            self.recycle(frame.data)
            return
        counts.frames += 1
        counts.damaged += lost > 0
        now = time.monotonic()
        self._deliver(
            ReceivedFrame(self._delivered, frame.data, lost, frame.stamp_s, now)
        )

    def _set_aside(self, sequence, place, packet, *, late) -> None:
        """Keep a packet that does not fit, with those that agree with it."""
        self._since = 0
        for other in [*self._aside]:
            moved = _moved(sequence, place, *other)
            if not moved or abs(moved) > self.window:
                self._drop_aside(other)
        self._aside[sequence, place] = packet, late
        if len(self._aside) < NEW_STREAM:
            return
        begun = [(*counters, packet) for counters, (packet, _) in self._aside.items()]
        self._aside.clear()
        moved = _moved(sequence, place, *self._newest)
        ahead = moved is not None and moved > 0
        if self._is_second(sequence, place, moved) and self._others < self._gone:
            self._others += len(begun)
            self.counts.ignored += len(begun)
            return
        self._left, self._others = self._newest, 0
        if ahead:
            for sequence, place, packet in begun:
                moved = _moved(sequence, place, *self._newest)
                self._accept(sequence, place, packet, moved)
            return
        self.flush()
        self.counts.restarts += 1
        self.counts.packets -= len(begun)  # counted when they first came
        for *_, packet in begun:
            self.add(packet)

    def _is_second(self, sequence: int, place: int, moved: int | None) -> bool:
        """True for packets that a second card may have sent."""
        if moved is not None and moved > LONG_GAP * self.frame_bytes + self.window:
            return True
        if self._left is None:
            return False
        on = _moved(sequence, place, *self._left)
        return on is not None and on >= -self.window

    def _drop_aside(self, *which: tuple[int, int]) -> None:
        """Count packets that were set aside, all by default, and forget them."""
        for counters in which or [*self._aside]:
            _, late = self._aside.pop(counters)
            if late:
                self.counts.late += 1
            else:
                self.counts.ignored += 1


def _follows(packets, sizes) -> Bool[np.ndarray, " packet_and_end"]:
    """Return which packets begin where a whole one ends; False after the last."""
    sequences = packets[:, :4].copy().view("<u4")[:, 0]
    places = packets[:, 4:8].copy().view("<u4")[:, 0].astype(np.int64)
    places |= packets[:, 8:10].copy().view("<u2")[:, 0].astype(np.int64) << 32
    whole = np.asarray(sizes) == MOST_PACKET
    follows = np.zeros(len(sizes) + 1, bool)
    follows[1:-1] = (
        (np.diff(sequences) == 1)  # wraps around
        & (np.diff(places) % BYTES == PAYLOAD)
        & whole[1:]
        & whole[:-1]
    )
    return follows


def _moved(sequence: int, place: int, at_sequence: int, at_place: int) -> int | None:
    """Return the bytes from one packet to another; None if their counters disagree."""
    packets = (sequence - at_sequence + SEQUENCES // 2) % SEQUENCES - SEQUENCES // 2
    moved = (place - at_place + BYTES // 2) % BYTES - BYTES // 2
    return moved if abs(packets * PAYLOAD - moved) <= SLACK else None
