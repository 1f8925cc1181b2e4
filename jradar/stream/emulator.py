"""An emulated capture card, which answers commands and sends a recording.

Packets have the form and pace of the card's. As in a network, some are lost, overtake
one another or arrive twice. As on the card, the bytes at the end of a frame that do not
fill a packet leave with the next frame.
"""

import dataclasses
import heapq
import math
import random
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from jradar.errors import UsageError
from jradar.outputs.published import FALLBACK_PERIOD_S
from jradar.recordings import Recording, Stream, need_samples
from jradar.recordings.ti.iq_order import words_of_cube
from jradar.recordings.ti.packets import PAYLOAD
from jradar.stream.protocol import (
    Command,
    NetworkSpec,
    pack_packet,
    pack_reply,
    unpack_command,
)
from jradar.stream.sockets import not_sent, udp_socket

BURST = 16  # packets that are sent together
ACTIVE = 0.6  # share of the frame period in which the packets are sent
WAKE_S = 0.05
VERSION = 2 | 8 << 7  # major and minor
MOST_REORDER = 1000


@dataclasses.dataclass(frozen=True)
class FaultSpec:
    """Faults of packets: probabilities, and the places by which they may be late."""

    loss: float = 0.0
    reorder: int = 0
    duplicate: float = 0.0
    seed: int = 0

    def __post_init__(self):
        for name in ("loss", "duplicate"):
            if not 0 <= getattr(self, name) <= 1:
                raise UsageError(f"{name} = {getattr(self, name)}, expected 0 to 1")
        if not 0 <= self.reorder <= MOST_REORDER:
            raise UsageError(
                f"reorder = {self.reorder}, expected 0 to {MOST_REORDER} packets"
            )


@dataclasses.dataclass
class Sent:
    """What an emulated card has sent; `packets` counts repeated ones, not lost ones."""

    frames: int = 0
    packets: int = 0
    lost: int = 0
    repeated: int = 0


def recorded_frames(recording: Recording) -> Stream:
    """Return the frames of a recording as the card sends them: bytes, in its order."""
    spec = recording.radar.spec
    order = recording.iq_order or ("I" if spec.real_samples else "IIQQ")

    def read(index: int) -> bytes:
        words = words_of_cube(recording.cubes[index], spec, order)
        return words.astype("<i2").tobytes()

    return Stream(read, len(recording.cubes))


class Emulator:
    """A card that sends `frames` on command; a `with` block ends its threads."""

    def __init__(
        self,
        frames: Sequence[Any],
        network: NetworkSpec,
        *,
        period_s: float,
        faults: FaultSpec = FaultSpec(),
        repeat: bool = False,
        first_sequence: int = 1,
        first_byte: int = 0,
    ):
        """Take `frames` of bytes, sent every `period_s`; 0 sends as fast as possible.

        `repeat` begins again after the last one. The counters of the first packet can
        be set, to see them wrap around. Raises OSError if the command port is taken.
        """
        if not 0 <= period_s < math.inf:
            raise UsageError(f"period_s = {period_s}, expected 0 or more")
        self.frames, self.network, self.period_s = frames, network, period_s
        self.faults, self.repeat = faults, repeat
        self.first = first_sequence, first_byte
        self.sent = Sent()
        self.finished = threading.Event()  # the last frame is sent
        self.fault: Exception | None = None  # error of the recording that ended it
        self._ending, self._stopped = threading.Event(), threading.Event()
        card = network.card
        self._commands = udp_socket(card, network.command_port, timeout_s=WAKE_S)
        try:
            self._data = udp_socket(card, 0, timeout_s=WAKE_S)
        except OSError:
            self._commands.close()
            raise
        self._answering = threading.Thread(target=self._answer, daemon=True)
        self._sending: threading.Thread | None = None

    def __enter__(self) -> "Emulator":
        self._answering.start()
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def close(self) -> None:
        """Stop sending and answering, and free the ports."""
        self._ending.set()
        self.stop()
        if self._answering.is_alive():
            self._answering.join()
        self._commands.close()
        self._data.close()

    def start(self) -> None:
        """Send from the first frame, as the command START does."""
        if self._sending is not None and self._sending.is_alive():
            return
        self._stopped.clear()
        self.finished.clear()
        self._sending = threading.Thread(target=self._send, daemon=True)
        self._sending.start()

    def stop(self) -> None:
        """Stop sending, as the command STOP does."""
        self._stopped.set()
        if self._sending is not None:
            self._sending.join()

    def _answer(self) -> None:
        while not self._ending.is_set():
            try:
                raw, sender = self._commands.recvfrom(2048)
                code, _ = unpack_command(raw)
            except (BlockingIOError, InterruptedError, ValueError):
                continue
            status = self._obey(code)
            self._commands.sendto(pack_reply(code, status), sender)

    def _obey(self, code: int) -> int:
        """Do what a command says; return the status of the reply."""
        if code == Command.START:
            self.start()
        elif code == Command.STOP:
            self.stop()
        elif code == Command.VERSION:
            return VERSION
        return 0 if code in [*Command] else 1

    def _send(self) -> None:
        try:
            if not self._send_all():
                return
        except Exception as error:  # from the recording's reader
            self.fault = error
        self.finished.set()

    def _send_all(self) -> bool:
        """Return False if the card was stopped before the last packet."""
        address = self.network.host, self.network.data_port
        begin, waiting = time.monotonic(), 0
        arriving = spoil(self._packets(), self.faults, self.sent)
        for due_s, packet in arriving:
            if not waiting:
                self._stopped.wait(max(begin + due_s - time.monotonic(), 0.0))
                waiting = BURST
            if self._stopped.is_set():
                return False
            waiting -= 1
            try:
                self._data.sendto(packet, address)
            except ConnectionRefusedError:  # nobody listens yet
                pass
            except OSError as error:
                raise not_sent(error, self.network.card, address[0]) from error
            self.sent.packets += 1
        return True

    def _packets(self) -> Iterator[tuple[float, bytes]]:
        """Yield each packet and when it is due, in seconds after the start."""
        (sequence, place), rest, number = self.first, b"", 0
        for number, frame in enumerate(self._in_turn()):
            stream = rest + bytes(frame)
            whole = len(stream) // PAYLOAD * PAYLOAD
            step = ACTIVE * self.period_s * PAYLOAD / max(whole, PAYLOAD)
            for i, at in enumerate(range(0, whole, PAYLOAD)):
                due_s = number * self.period_s + i * step
                yield due_s, pack_packet(sequence, place, stream[at : at + PAYLOAD])
                sequence, place = sequence + 1, place + PAYLOAD
            rest = stream[whole:]
            self.sent.frames += 1
        if rest:
            yield (
                number * self.period_s + self.period_s,
                pack_packet(sequence, place, rest),
            )

    def _in_turn(self) -> Iterator[Any]:
        while True:
            for index in range(len(self.frames)):
                yield self.frames[index]
            if not self.repeat:
                return


def replaying(
    recording: Recording,
    network: NetworkSpec,
    *,
    speed: float = 1.0,
    faults: FaultSpec = FaultSpec(),
    repeat: bool = False,
) -> Emulator:
    """Return a card that sends a recording `speed` times as fast as it was recorded.

    The radar's description gives the period of frames, or else their times do.
    """
    need_samples(recording)
    period_s, stamps = recording.radar.spec.frame_period_s, recording.cubes.stamps
    if not period_s and stamps is not None and len(stamps) > 1:
        period_s = float(np.median(np.diff(stamps)))
    return Emulator(
        recorded_frames(recording),
        network,
        period_s=(period_s or FALLBACK_PERIOD_S) / speed,
        faults=faults,
        repeat=repeat,
    )


def spoil(
    packets: Iterable[tuple[float, bytes]], faults: FaultSpec, sent: Sent
) -> Iterator[tuple[float, bytes]]:
    """Yield the packets that arrive, in the order in which they do."""
    chance = random.Random(faults.seed)
    on_the_way: list[tuple[float, int, float, bytes]] = []
    copies = 0
    for index, (due_s, packet) in enumerate(packets):
        while on_the_way and on_the_way[0][0] <= index:
            *_, due, arriving = heapq.heappop(on_the_way)
            yield due, arriving
        if chance.random() < faults.loss:
            sent.lost += 1
            continue
        again = chance.random() < faults.duplicate
        sent.repeated += again
        for _ in range(1 + again):
            copies += 1
            late = chance.uniform(0, faults.reorder) if faults.reorder else 0.0
            heapq.heappush(on_the_way, (index + late, copies, due_s, packet))
    while on_the_way:
        *_, due, arriving = heapq.heappop(on_the_way)
        yield due, arriving
