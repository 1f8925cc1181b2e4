"""The images of the last frames, for models whose condition holds several.

A condition of training holds images 0.05 s apart, newest first, and a trajectory's
first image also stands for those before it. At another frame rate, the image nearest in
time stands for each.
"""

import collections
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jradar.errors import UsageError
from jradar.model.grids.polar import RADARHD
from jradar.recordings import Recording

STEP_S = RADARHD.frame_period_s  # between the images of a condition
SLOWEST_S = 2.5 * STEP_S  # between frames; at more, an image stands for too many


class Image(NamedTuple):
    """The image of one frame, and its time."""

    stamp_s: float
    radar: Float[Any, "range azimuth"]


class LastImages:
    """The images of the last frames of one radar, in order of time."""

    def __init__(self, history: int):
        """`history` images make a condition."""
        self._history = history
        self._seen = collections.deque[Image]()

    @property
    def span_s(self) -> float:
        """The time from the oldest image of a condition to the newest."""
        return STEP_S * (self._history - 1)

    def add(
        self, condition: Float[Any, "range azimuth image"], stamp_s: float
    ) -> Float[Any, "range azimuth image"]:
        """Add a frame; return the condition of the last ones, newest first.

        The frame's own `condition` has its image in every place.
        """
        while self._seen and not 0 < stamp_s - self._seen[-1].stamp_s <= self.span_s:
            self._seen.pop()  # time was set back, or there was a long pause
        self._seen.append(Image(stamp_s, condition[..., 0]))
        while len(self._seen) > 2 and stamp_s - self._seen[1].stamp_s > self.span_s:
            self._seen.popleft()
        stamps = np.array([image.stamp_s for image in self._seen])
        wanted = stamp_s - STEP_S * np.arange(self._history)
        nearest = abs(wanted[:, None] - stamps).argmin(1)
        return np.stack([np.asarray(self._seen[k].radar) for k in nearest], -1)


def frame_times(recording: Recording) -> Float[np.ndarray, " frame"] | None:
    """Return the time of each frame in seconds, None if it is not known.

    Without stamps, frames follow one another in the radar's frame period.
    """
    stamps, period_s = recording.frames.stamps, recording.frame_period_s
    if stamps is None:
        return period_s * np.arange(len(recording.frames)) if period_s else None
    return np.asarray(stamps, float)


def check_history(recording: Recording) -> None:
    """Raise UsageError for a recording whose frames make no history.

    The times of such frames are unknown, or the frames are too far apart in time.
    """
    times, count = frame_times(recording), len(recording.frames)
    if times is None or count < 2:
        raise UsageError(
            f"{recording.path} has {count} frames and no known time between them, "
            "which a model of several images needs: use a model of one image, such as "
            "radarhd"
        )
    if (step_s := float(np.median(np.diff(times)))) > SLOWEST_S:
        raise UsageError(
            f"{recording.path} has a frame every {step_s:.3g} s, expected at most "
            f"{SLOWEST_S:g} s for a model of several images: use a model of one image, "
            "such as radarhd"
        )
