"""The points of the last seconds, in the radar's present frame, each with its age.

    points of a frame --> what stands still of them, kept
    earlier points    --> moved by the radar's motion  --> one cloud, newest first

The motion is that of recorded poses, or else of Doppler and the IMU. Where it is not
known, where time or the poses jump, the earlier points are dropped, and a warning says
so. Velocities are those that were measured in their frame.
"""

import collections
from collections.abc import Iterator
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from jradar.motion import Follower, ego_velocity
from jradar.recordings import Recording
from jradar.types import SIZES, PointCloud

MOST_FRAMES = 64
MOST_POINTS = SIZES[2]  # of all frames; the newest are kept
JUMP_MPS = 3.0  # by which a step differs from the radar's velocity, if it jumps
KEY = 0  # of the samples that find the radar's velocity
REASONS = {
    "motion": "the radar's motion into it is unknown",
    "time": "the time before it jumps",
    "poses": "the poses before it jump",
}


class Kept(NamedTuple):
    """What stood still in a frame, in the radar's frame at that time."""

    stamp_s: float
    points: PointCloud  # of NumPy arrays, all valid


class LastPoints:
    """The points of a recording's last frames, in the order of time; host."""

    def __init__(
        self,
        recording: Recording,
        seconds: float,
        *,
        unambiguous_mps: float | None = None,
    ):
        """Points are at most so many seconds old.

        `unambiguous_mps` is the largest velocity that they hold without folding.
        """
        self._follower = Follower(recording, frames=MOST_FRAMES)
        self._seconds, self._limit = seconds, unambiguous_mps
        self._elevation = recording.has_elevation
        self._frames = collections.deque[Kept](maxlen=MOST_FRAMES)
        self._velocity = np.full(3, np.nan)
        self._alone: dict[str, list[int]] = {reason: [] for reason in REASONS}

    def add(self, number: int, stamp_s: float, points: PointCloud) -> PointCloud:
        """Return the points of a frame, and of those before it, padded.

        `stamp_s` is NaN if it is not known.
        """
        still, velocity = self._still(points)
        poses = self._follower.step(stamp_s, velocity)
        if self._frames and (why := self._broken(stamp_s, poses, velocity)):
            self._alone[why].append(number)
            self._frames.clear()
        self._velocity = velocity
        present = _host(points)
        parts = [present._replace(age=np.zeros(len(present.valid), np.float32))]
        for pose, frame in zip(poses[1:], self._frames, strict=False):
            age = stamp_s - frame.stamp_s
            if age > self._seconds or not np.isfinite(pose).all():
                break
            xyz = frame.points.xyz @ pose[:3, :3].T + pose[:3, 3]
            ages = np.full(len(xyz), age, np.float32)
            parts.append(frame.points._replace(xyz=np.float32(xyz), age=ages))
        self._frames.appendleft(Kept(stamp_s, _host(points._replace(valid=still))))
        columns: Any = zip(*parts, strict=True)
        joined = (None if c[0] is None else np.concatenate(c) for c in columns)
        newest: Any = (None if c is None else c[:MOST_POINTS] for c in joined)
        whole = PointCloud(*newest)
        return whole.padded()

    def _still(self, points: PointCloud) -> tuple[np.ndarray, np.ndarray]:
        """Return which points do not move, and the radar's velocity."""
        valid = np.asarray(points.valid)
        if points.velocity is None:
            return valid, np.full(3, np.nan)
        found = jax.device_get(
            ego_velocity(
                jax.random.key(KEY),
                points,
                elevation=self._elevation,
                unambiguous_mps=self._limit,
                folds=0,
            )
        )
        return valid & ~found.moving, found.velocity

    def _broken(
        self,
        stamp_s: float,
        poses: Float[np.ndarray, "frame 4 4"],
        velocity: np.ndarray,
    ) -> str:
        """Return why the frame before belongs to another time or place, else ""."""
        seconds = stamp_s - self._frames[0].stamp_s
        if not 0 < seconds <= self._seconds:  # NaN, too
            return "time" if np.isfinite(seconds) else "motion"
        if not np.isfinite(poses[1]).all():
            return "motion"
        moved = -poses[1][:3, :3].T @ poses[1][:3, 3] / seconds
        known = [v for v in (self._velocity, velocity) if np.isfinite(v).all()]
        if known and np.linalg.norm(moved - np.mean(known, 0)) > JUMP_MPS:
            return "poses"
        return ""

    @property
    def steps(self) -> dict[str, int]:
        """The number of steps that each source of motion gave."""
        return dict(self._follower.steps)

    def warnings(self) -> Iterator[str]:
        """Yield a warning for each reason for which frames stand alone."""
        for reason, numbers in self._alone.items():
            if numbers:
                which = f"frame {numbers[0]}"
                which += f" and {len(numbers) - 1} more" if len(numbers) > 1 else ""
                yield (f"no earlier points were added to {which}: {REASONS[reason]}")


def _host(points: PointCloud) -> PointCloud:
    """Return the valid points, as NumPy arrays."""
    valid = np.asarray(points.valid)
    columns: Any = (None if c is None else np.asarray(c)[valid] for c in points)
    return PointCloud(*columns)
