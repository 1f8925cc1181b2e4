"""Plays the points of a recording at the times at which they were recorded."""

import itertools
import time

import numpy as np
from jaxtyping import Float

from jradar.outputs.published import FALLBACK_PERIOD_S
from jradar.recordings import Stream
from jradar.stream.source import ReceivedFrame, Source


class Player(Source):
    """Frames of points as a radar would send them."""

    def __init__(
        self,
        points: Stream,
        *,
        speed: float = 1.0,
        repeat: bool = False,
        waiting: int = 1,
    ):
        """Play `points` `speed` times as fast as they were recorded.

        Frames without times follow one another in 0.1 s. `repeat` begins again after
        the last one. At most `waiting` frames wait to be taken.
        """
        super().__init__(waiting)
        self.finished = False  # the last frame is delivered
        self._points, self._repeat = points, repeat
        self._periods_s = periods(points) / speed
        self._due_s = 0.0  # of the next frame, on the monotonic clock

    def silence(self, limit_s: float) -> str:
        """Return how long a gap of the recording lasts, if it is that long; else ""."""
        gap_s = self._due_s - self.heard_s
        if not self.heard or min(gap_s, time.monotonic() - self.heard_s) < limit_s:
            return ""
        return f"by its times, the recording has no frame for {gap_s:.1f} s"

    def _listen(self) -> None:
        self._due_s = time.monotonic()
        for number in itertools.count():
            index = number % len(self._points)
            cloud = self._points[index]
            if self._ending.wait(max(self._due_s - time.monotonic(), 0.0)):
                return
            self.heard_s = time.monotonic()
            self._deliver(ReceivedFrame(number, cloud, 0, time.time(), self.heard_s))
            self._due_s += self._periods_s[index]
            if index == len(self._points) - 1 and not self._repeat:
                break
        self.finished = True


def periods(points: Stream) -> Float[np.ndarray, " frame"]:
    """Return the seconds from each frame to the next.

    Those of frames whose stamps do not rise are 0. That of the last frame, after which
    a recording begins again, is the median of the others.
    """
    if points.stamps is None or len(points) < 2:
        return np.full(len(points), FALLBACK_PERIOD_S)
    steps = np.maximum(np.diff(points.stamps), 0.0)
    return np.append(steps, np.median(steps))
