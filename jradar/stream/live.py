"""A live session starts the card and the board, and publishes the newest frame."""

import contextlib
import dataclasses
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jradar.errors import UsageError
from jradar.outputs.writers import Writer
from jradar.recordings import nearest_scan
from jradar.stream.assembler import ReceivedFrame
from jradar.stream.board import Board
from jradar.stream.card import Card
from jradar.stream.emulator import Emulator, Sent
from jradar.stream.processing import Processor
from jradar.stream.receiver import Receiver

REMEMBERED = 10_000  # frames whose latency counts
WAKE_S = 0.1
SILENCE_S = 5.0
LINE_S = 10.0  # between lines of status if stderr is not a terminal
RATE_FRAMES, RATE_S = 10, 3.0  # after which the frame rate is compared
RATE_TOLERANCE = 0.1
DRAIN_S = 1.0  # after the last packet of a replay
FOUR_LANES = ("I4Q4", "Q4I4")


@dataclasses.dataclass
class Session:
    """What a session has published so far."""

    published: int = 0
    begin_s: float = 0.0  # of the first frame, on the monotonic clock
    end_s: float = 0.0  # of the last one
    warnings: list[str] = dataclasses.field(default_factory=list)
    latencies_s: deque[float] = dataclasses.field(
        default_factory=lambda: deque(maxlen=REMEMBERED)
    )

    def add(self, arrived_s: float) -> None:
        """Count a frame that has just been published."""
        now = time.monotonic()
        self.begin_s = self.begin_s or now
        self.end_s = now
        self.published += 1
        self.latencies_s.append(now - arrived_s)

    @property
    def frames_per_s(self) -> float:
        """Rate of published frames; 0 before the second one."""
        seconds = self.end_s - self.begin_s
        return (self.published - 1) / seconds if seconds else 0.0

    def latency_ms(self, percent: int) -> float:
        """Return a percentile of the time from a frame's last packet to its cloud."""
        if not self.latencies_s:
            return 0.0
        return 1e3 * float(np.percentile([*self.latencies_s], percent))


def run_session(
    receiver: Receiver,
    processor: Processor,
    writers: Sequence[Writer],
    *,
    emulator: Emulator | None = None,
    commands: bool = True,
    packet_delay_us: float = 25.0,
    board: str | None = None,
    silence_s: float = SILENCE_S,
    seconds: float | None = None,
    keep: Callable[[ReceivedFrame], None] | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> Session:
    """Start the card and the board, publish frames as `run_live` does, and stop both.

    An `emulator` plays the processor's recording, whose LiDAR scans are published, too;
    the session ends with it. `board` is a serial port, to which the .cfg that describes
    the radar is sent. Without `commands`, another program starts the card.
    """
    recording = processor.recording

    def played() -> bool:
        """True once a replay is over and its packets have had time to arrive."""
        over = emulator is not None and emulator.finished.is_set()
        return over and bool(receiver.silence(DRAIN_S))

    def scan(number: int) -> np.ndarray | None:
        """Return the LiDAR scan that was recorded with a frame that is replayed."""
        if recording.lidar is None:
            return None
        return nearest_scan(recording, number % len(recording.cubes))

    if keep is None:
        processor.warm_up()
    with contextlib.ExitStack() as stack:
        stack.enter_context(receiver)
        if emulator is not None:
            stack.enter_context(emulator)
        if commands or emulator is not None:
            lanes = 4 if recording.iq_order in FOUR_LANES else 2
            card = stack.enter_context(Card(receiver.network))
            card.set_up(lanes=lanes, delay_us=packet_delay_us)
            card.start()
            stack.callback(_quietly, card.stop)
        if board is not None:
            _start_board(stack, board, recording.path)
        session = run_live(
            receiver,
            processor,
            writers,
            silence_s=silence_s,
            seconds=seconds,
            finished=played,
            lidar=scan,
            keep=keep,
            say=say,
        )
        receiver.close()  # packets that come while the devices stop do not count
    if emulator is not None and emulator.fault is not None:
        raise emulator.fault
    return session


def _start_board(stack: contextlib.ExitStack, port: str, cfg: Path) -> None:
    """Send the board its .cfg; the stack stops the board at its end."""
    if cfg.suffix != ".cfg":
        raise UsageError(f"--board sends a .cfg to the board, but --radar is {cfg}")
    device = stack.enter_context(Board(port))
    stack.callback(_quietly, device.stop)
    device.configure(cfg)


def _quietly(stop: Callable[[], None]) -> None:
    """Stop a device; ignore one that no longer answers."""
    with contextlib.suppress(OSError, ValueError):
        stop()


def run_live(
    receiver: Receiver,
    processor: Processor,
    writers: Sequence[Writer],
    *,
    silence_s: float = SILENCE_S,
    seconds: float | None = None,
    finished: Callable[[], bool] = lambda: False,
    lidar: Callable[[int], np.ndarray | None] = lambda number: None,
    keep: Callable[[ReceivedFrame], None] | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> Session:
    """Publish the newest frame until the end: SIGINT, SIGTERM, `seconds`, `finished`.

    `finished` is called while no frame waits. `lidar` returns the scan to publish with
    a frame. With `keep`, nothing is published: it takes the frames as they come. `say`
    is called with warnings. Raises TimeoutError, with what to check, if nothing comes
    from the card for the first `silence_s`; a card that falls silent later is reported.
    """
    session, line = Session(), StatusLine()
    session.warnings += [receiver.note] if receiver.note else []
    begin, rate = time.monotonic(), FrameRate(processor)
    silent = strange = False

    def warn(text: str) -> None:
        session.warnings.append(text)
        line.end()
        say(text)

    with ended_by_signals() as ending:
        while not ending.is_set():
            over, frame = finished(), receiver.take(WAKE_S)
            line.show(session, receiver)
            if not strange and (text := receiver.strangers()):
                strange = True
                warn(text)
            if seconds is not None and time.monotonic() - begin > seconds:
                break
            if frame is None:
                if over:
                    break
                for writer in writers:
                    writer.save()
                why = receiver.silence(silence_s)
                if why and not receiver.counts.placed:
                    raise TimeoutError(why)
                if why and not silent:
                    warn(why)
                silent = bool(why)
                continue
            if doubt := rate.add(frame.number, frame.arrived_s):
                warn(doubt)
            if keep is not None:
                keep(frame)
                receiver.recycle(frame)
                session.add(frame.arrived_s)
                continue
            cube = processor.cube(frame.data)
            receiver.recycle(frame)
            scan = lidar(frame.number)
            shown = processor.published(cube, frame.number, frame.stamp_s, lidar=scan)
            for writer in writers:
                writer.write(shown)
            session.add(frame.arrived_s)
    line.end()
    return session


def summary(session: Session, receiver: Receiver) -> dict[str, Any]:
    """Return what happened to frames and packets; call it once the receiver is closed.

    The frames received were either published or dropped. Frames that still waited at
    the end count as dropped.
    """
    counts = receiver.counts
    return {
        "frames received": counts.frames,
        "frames published": session.published,
        "frames dropped": counts.frames - session.published,
        "frames with losses": counts.damaged,
        "frames mostly lost": counts.sparse,
        "frames missing": counts.missing,
        "frames/s": session.frames_per_s,
        "latency, median (ms)": session.latency_ms(50),
        "latency, 95 % (ms)": session.latency_ms(95),
        "packets": {
            "received": counts.packets,
            "lost": counts.lost_packets,
            "repeated": counts.repeated,
            "late": counts.late,
            "not of the stream": counts.ignored,
            "malformed": counts.malformed,
            "of other senders": counts.foreign,
        },
        "restarts of the card": counts.restarts,
    }


def run_replay(emulator: Emulator) -> Sent:
    """Wait until a recording is sent, or a signal ends it; return what was sent.

    Raises the error that ended the sending, such as that of a damaged frame.
    """
    with ended_by_signals() as ending:
        while not (emulator.finished.is_set() or ending.is_set()):
            ending.wait(WAKE_S)
    emulator.stop()
    if emulator.fault is not None:
        raise emulator.fault
    return emulator.sent


class FrameRate:
    """Compares the rate of frames with that in the radar's description."""

    def __init__(self, processor: Processor):
        """Frames come every `frame_period_s` of the processor's radar, if known."""
        self.radar = processor.recording.radar.spec
        self.source = processor.recording.path
        self._first: tuple[int, float] | None = None
        self._told = False

    def add(self, number: int, arrived_s: float) -> str:
        """Return one warning if frames do not come at the described rate; else ""."""
        if self._first is None:
            self._first = number, arrived_s
        frames = number - self._first[0]
        elapsed, expected = arrived_s - self._first[1], self.radar.frame_period_s
        enough = frames >= RATE_FRAMES and elapsed >= RATE_S
        if self._told or not enough or not expected:
            return ""
        period = elapsed / frames
        if abs(period / expected - 1) <= RATE_TOLERANCE:
            return ""
        self._told = True
        return (
            f"{self.source} describes a frame every {1e3 * expected:.4g} ms, but its "
            f"number of bytes comes every {1e3 * period:.4g} ms: the frames on the "
            f"cable seem to be {expected / period:.3g} times as large. Does the board "
            "run another .cfg?"
        )


class StatusLine:
    """One line on stderr: rewritten on a terminal, else printed every ten seconds."""

    def __init__(self):
        self._shown_s = 0.0
        self._terminal = sys.stderr.isatty()

    def show(self, session: Session, receiver: Receiver) -> None:
        """Print the line if it is time."""
        now = time.monotonic()
        if not session.published or now - self._shown_s < (
            1.0 if self._terminal else LINE_S
        ):
            return
        self._shown_s = now
        text = (
            f"{session.published} frames, {session.frames_per_s:.1f} frames/s, latency "
            f"{session.latency_ms(50):.0f} ms (95 %: {session.latency_ms(95):.0f} ms), "
            f"{receiver.counts.lost_packets} packets lost, "
            f"{receiver.dropped} frames dropped"
        )
        end = "\r" if self._terminal else "\n"
        print(text.ljust(79), end=end, file=sys.stderr, flush=True)

    def end(self) -> None:
        """Leave the line on the terminal."""
        if self._terminal and self._shown_s:
            print(file=sys.stderr)


@contextlib.contextmanager
def ended_by_signals() -> Iterator[threading.Event]:
    """Yield an event that SIGINT and SIGTERM set; a second signal acts as usual.

    In threads other than the main one, signals are left as they are.
    """
    ending = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield ending
        return
    before = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)}

    def end(number: int, _: Any) -> None:
        ending.set()
        signal.signal(number, before[signal.Signals(number)])

    for number in before:
        signal.signal(number, end)
    try:
        yield ending
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
