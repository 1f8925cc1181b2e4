"""The live loop: the newest frame of a source becomes clouds, which are published."""

import contextlib
import dataclasses
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from jradar.outputs.writers import Writer
from jradar.progress import is_quiet
from jradar.recordings import Recording
from jradar.stream.processing import Processor
from jradar.stream.source import WAKE_S, ReceivedFrame, Source

REMEMBERED = 10_000  # frames whose latency counts
SILENCE_S = 5.0
LINE_S = 10.0  # between lines of status if stderr is not a terminal
RATE_FRAMES, RATE_S = 10, 3.0  # after which the frame rate is compared
RATE_TOLERANCE = 0.1


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
        """Return a percentile of the time from a frame's last bytes to its cloud."""
        if not self.latencies_s:
            return 0.0
        return 1e3 * float(np.percentile([*self.latencies_s], percent))


def run_live(
    source: Source,
    processor: Processor,
    writers: Sequence[Writer],
    *,
    silence_s: float = SILENCE_S,
    seconds: float | None = None,
    finished: Callable[[], bool] = lambda: False,
    keep: Callable[[ReceivedFrame], None] | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> Session:
    """Publish the newest frame until the end: SIGINT, SIGTERM, `seconds`, `finished`.

    `finished` is called while no frame waits. With `keep`, nothing is published: it
    takes the frames as they come. `say` is called with warnings. Raises TimeoutError,
    with what to check, if nothing comes from the radar for the first `silence_s`; a
    radar that falls silent later is reported. Raises the error that ended the source,
    such as OSError for a port that is gone, after the frames before it.
    """
    session, line = Session(), StatusLine()
    session.warnings += [source.note] if source.note else []
    begin, rate = time.monotonic(), FrameRate(processor.recording)
    silent = strange = False

    def warn(text: str) -> None:
        session.warnings.append(text)
        line.end()
        say(text)

    with ended_by_signals() as ending:
        while not ending.is_set():
            over, frame = finished(), source.take(WAKE_S)
            line.show(session, source)
            if not strange and (text := source.oddity()):
                strange = True
                warn(text)
            if seconds is not None and time.monotonic() - begin > seconds:
                break
            if frame is None:
                if over:
                    break
                for writer in writers:
                    writer.save()
                listened = time.monotonic() - begin >= silence_s
                why = source.silence(silence_s) if listened else ""
                if why and not source.heard:
                    raise TimeoutError(why)
                if why and not silent:
                    warn(why)
                silent = bool(why)
                continue
            if warning := rate.add(frame.number, frame.arrived_s):
                warn(warning)
            if keep is not None:
                keep(frame)
                source.recycle(frame)
                session.add(frame.arrived_s)
                continue
            measured = processor.measured(frame.data)
            source.recycle(frame)
            shown = processor.published(measured, frame.number, frame.stamp_s)
            for writer in writers:
                writer.write(shown)
            session.add(frame.arrived_s)
    line.end()
    return session


def summary(session: Session, source: Source) -> dict[str, Any]:
    """Return what happened to the frames; call it once the source is closed.

    The frames received were either published or dropped. Frames that still waited at
    the end count as dropped.
    """
    return {
        "frames received": source.received,
        "frames published": session.published,
        "frames dropped": source.received - session.published,
        "frames/s": session.frames_per_s,
        "latency, median (ms)": session.latency_ms(50),
        "latency, 95 % (ms)": session.latency_ms(95),
        **source.describe(),
    }


class FrameRate:
    """Compares the rate of frames of samples with that in the radar's description."""

    def __init__(self, recording: Recording):
        """Frames come every `frame_period_s` of a recording of samples, if known."""
        self.period_s = 0.0 if recording.of_points else recording.frame_period_s
        self.described = recording.path
        self._first: tuple[int, float] | None = None
        self._told = False

    def add(self, number: int, arrived_s: float) -> str:
        """Return one warning if frames do not come at the described rate; else ""."""
        if self._first is None:
            self._first = number, arrived_s
        frames = number - self._first[0]
        elapsed, expected = arrived_s - self._first[1], self.period_s
        enough = frames >= RATE_FRAMES and elapsed >= RATE_S
        if self._told or not enough or not expected:
            return ""
        period = elapsed / frames
        if abs(period / expected - 1) <= RATE_TOLERANCE:
            return ""
        self._told = True
        return (
            f"{self.described} describes a frame every {1e3 * expected:.4g} ms, but "
            f"its number of bytes comes every {1e3 * period:.4g} ms: the frames on the "
            f"cable seem to be {expected / period:.3g} times as large. Does the board "
            "run another .cfg?"
        )


class StatusLine:
    """One line on stderr: rewritten on a terminal, else printed every ten seconds.

    It is not printed where `is_quiet` says so.
    """

    def __init__(self):
        self._shown_s = 0.0
        self._terminal, self._quiet = sys.stderr.isatty(), is_quiet()

    def show(self, session: Session, source: Source) -> None:
        """Print the line if it is time."""
        now = time.monotonic()
        if (
            self._quiet
            or not session.published
            or now - self._shown_s < (1.0 if self._terminal else LINE_S)
        ):
            return
        self._shown_s = now
        parts = (
            f"{session.published} frames, {session.frames_per_s:.1f} frames/s",
            f"latency {session.latency_ms(50):.0f} ms "
            f"(95 %: {session.latency_ms(95):.0f} ms)",
            source.losses(),
            f"{source.dropped} frames dropped",
        )
        text = ", ".join(filter(None, parts))
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
