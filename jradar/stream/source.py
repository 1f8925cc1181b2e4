"""A source of a live radar's frames: a thread that listens, and frames that wait.

    Receiver        samples, which a capture card sends in packets
    PointsPort      points, which a board sends over its data port
    Player          points of a recording, at their times

The thread does nothing else. Whoever takes frames too slowly gets the newest; those
that it missed are counted in `dropped`.
"""

import abc
import threading
import time
from collections import deque
from typing import Any, NamedTuple

WAKE_S = 0.1  # after which a thread checks whether it should end


class ReceivedFrame(NamedTuple):
    """A frame as it came from the cable."""

    number: int  # counted from the start of the stream, with missing frames
    data: Any  # the bytes of samples, lost ones as zeros; or a PointCloud
    lost_bytes: int  # of samples; points come whole or not at all
    stamp_s: float  # arrival of its first bytes, seconds since 1970
    arrived_s: float  # arrival of its last bytes, on the monotonic clock


class Source(abc.ABC):
    """Frames of a radar as they come; a `with` block starts and ends the thread."""

    note = ""  # about this machine, before anything comes

    def __init__(self, waiting: int = 1):
        """At most `waiting` frames wait to be taken."""
        self.received = self.dropped = 0  # frames so far; those that nobody took
        self.heard_s = time.monotonic()  # of the radar, on the monotonic clock
        self._frames: deque[ReceivedFrame] = deque()
        self._waiting = waiting
        self._arrived = threading.Condition()
        self._ending = threading.Event()
        self._fault: Exception | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> "Source":
        self.heard_s = time.monotonic()
        self._thread.start()
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def close(self) -> None:
        """End the thread; frames that wait can still be taken."""
        self._ending.set()
        if self._thread.is_alive():
            self._thread.join()

    def take(self, timeout_s: float) -> ReceivedFrame | None:
        """Return the oldest frame that waits, or None if none comes in time.

        Raises the error that ended the thread, if one did, once no frame waits.
        """
        with self._arrived:
            self._arrived.wait_for(lambda: self._frames or self._fault, timeout_s)
            if self._frames:
                return self._frames.popleft()
        if self._fault is not None:
            raise self._fault
        return None

    def recycle(self, frame: ReceivedFrame) -> None:  # noqa: B027
        """Take back a frame whose data nobody needs any more."""

    @property
    def heard(self) -> bool:
        """Whether anything of the radar's stream has come."""
        return self.received > 0

    @abc.abstractmethod
    def silence(self, limit_s: float) -> str:
        """Return why nothing may have come for `limit_s`, and what to check; or ""."""

    def oddity(self) -> str:
        """Return a warning about what comes, else ""."""
        return ""

    def losses(self) -> str:
        """Return what was lost so far, in a few words, else ""."""
        return ""

    def describe(self) -> dict[str, Any]:
        """Return what was lost, by name."""
        return {}

    @abc.abstractmethod
    def _listen(self) -> None:
        """Deliver frames until `_ending` is set."""

    def _deliver(self, frame: ReceivedFrame) -> None:
        with self._arrived:
            while len(self._frames) >= self._waiting:
                self.recycle(self._frames.popleft())
                self.dropped += 1
            self._frames.append(frame)
            self.received += 1
            self._arrived.notify()

    def _run(self) -> None:
        """Listen until the end; `take` raises an error that ends it early."""
        try:
            self._listen()
        except Exception as error:
            with self._arrived:
                self._fault = error
                self._arrived.notify_all()
