"""Fuses the last frames: what each of them saw, and where the radar was then."""

import collections
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jradar.diffusion import RangeMixture
from jradar.model import Model, fuse, mixtures, moving_pixels
from jradar.model.fusion import view_grid
from jradar.motion import Follower, ego_velocity
from jradar.radar import RadarSpec
from jradar.range_image import RangeImage
from jradar.recordings import Recording
from jradar.types import PointCloud

NAMED = 5  # frames in a warning
KEY = 0  # of the samples that find the radar's velocity


class Seen(NamedTuple):
    """Surfaces in one frame, what moves, and the radar's own velocity."""

    mixture: RangeMixture
    moving: Bool[Array, "*frame row column"]
    velocity: Float[Array, "*frame 3"]  # m/s, NaN where unknown


def see(
    points: PointCloud,
    condition: Float[Array, "row column channel"],
    model: Model,
    radar: RadarSpec | None,
) -> Seen:
    """Return what one frame shows of surfaces, movers and the radar's velocity.

    Without a `radar`, it measures elevations, and velocities of any size. Points
    without velocities show neither movers nor the radar's own.
    """
    mixture = mixtures(condition, model)
    if points.velocity is None:
        still = jnp.zeros(mixture.returned.shape, bool)
        return Seen(mixture, still, jnp.full(3, jnp.nan))
    unambiguous = None
    if radar is not None:
        unambiguous = radar.max_velocity_mps * (2 * model.spec.points.folds + 1)
    velocity = ego_velocity(
        jax.random.key(KEY),
        points,
        elevation=radar is None or radar.has_elevation,
        unambiguous_mps=unambiguous,
        folds=0,
    ).velocity
    limit = {"unambiguous_mps": unambiguous}
    moving = moving_pixels(mixture, points, velocity, view_grid(model), **limit)
    return Seen(mixture, moving, velocity)


def fused(
    seen: Sequence[Seen],
    poses: Float[Array, "frame 4 4"],
    model: Model,
    *,
    least_confidence: float | None = None,
) -> RangeImage:
    """Return `fuse` of frames, newest first, without what moves by itself."""
    frames = jax.tree.map(lambda *values: jnp.stack(values), *seen)
    return fuse(
        frames.mixture,
        poses,
        model,
        moving=frames.moving,
        least_confidence=least_confidence,
    )


class LastFrames:
    """The last frames of a recording, each with its place relative to the newest."""

    def __init__(self, recording: Recording, count: int):
        """`count` frames are kept, the newest included."""
        self._follower = Follower(recording, frames=count)
        self._seen = collections.deque[Seen](maxlen=count)
        self._count = count
        self._alone: list[int] = []  # the first frames with unknown motion before them

    def add(
        self, frame: int, stamp_s: float, seen: Seen
    ) -> tuple[tuple[Seen, ...], Float[np.ndarray, "frame 4 4"]]:
        """Add a frame; return what `fused` takes: `count` frames, newest first.

        `stamp_s` is the time at which the frame began, NaN if it is not known. Frames
        that are not there yet have poses of NaN.
        """
        earlier = len(self._seen)
        self._seen.appendleft(seen)
        poses = self._follower.step(stamp_s, np.asarray(seen.velocity))
        known = not earlier or np.isfinite(poses[1:]).all()
        if not known and len(self._alone) <= NAMED:
            self._alone.append(frame)
        missing = self._count - len(self._seen)
        nothing = np.full((missing, 4, 4), np.nan)
        frames = (*self._seen, *[seen] * missing)
        return frames, np.concatenate([poses, nothing]).astype(np.float32)

    @property
    def steps(self) -> dict[str, int]:
        """The number of steps that each source of motion gave."""
        return dict(self._follower.steps)

    def warnings(self) -> Iterator[str]:
        """Yield a warning about frames without known motion."""
        if alone := self._alone:
            names = ", ".join(map(str, alone[:NAMED])) + ", .." * (len(alone) > NAMED)
            yield (
                f"the radar's motion into frame {names} is unknown: fewer than "
                f"{self._count} frames are fused there"
            )
