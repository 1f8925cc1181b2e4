"""`jradar enhance --fuse N`: the last N frames of a recording as one."""

import argparse
import collections
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jradar.diffusion import RangeMixture
from jradar.errors import UsageError
from jradar.model import Model, ModelSpec, fuse, mixtures, moving_pixels
from jradar.motion import Follower, ego_velocity
from jradar.range_image import RangeImage
from jradar.recordings import Recording
from jradar.types import PointCloud

KEY = 0  # of the samples that find the radar's velocity


class Seen(NamedTuple):
    """What one frame tells: surfaces, what moves, and the radar's own velocity."""

    mixture: RangeMixture
    moving: Bool[Array, "row column"]
    velocity: Float[Array, " 3"]  # m/s, NaN where unknown


def check_fusing(
    options: argparse.Namespace, spec: ModelSpec, recording: Recording
) -> None:
    """Raise UsageError for models and recordings whose frames cannot be fused."""
    if spec.method != "marginal":
        raise UsageError(
            f"--fuse {options.fuse}: the method of {options.model} is {spec.method}, "
            "expected marginal: a model of one pass, such as jradar-sim, whose "
            "distributions over range are fused"
        )
    if options.draws or options.steps:
        raise UsageError(
            "--draws, --steps: a model of one pass draws no samples, leave these out"
        )
    if len(recording.cubes) < 2:
        raise UsageError(
            f"--fuse {options.fuse}: {options.path} has one frame, expected several: "
            "leave --fuse out"
        )


def see(
    points: PointCloud,
    condition: Float[Array, "row column channel"],
    model: Model,
    recording: Recording,
) -> Seen:
    """Return what one frame tells."""
    radar, spec = recording.radar, model.spec
    unambiguous = radar.max_velocity_mps * (2 * spec.points.folds + 1)
    velocity = ego_velocity(
        jax.random.key(KEY),
        points,
        elevation=radar.has_elevation,
        unambiguous_mps=unambiguous,
        folds=0,
    ).velocity
    mixture = mixtures(condition, model)
    moving = moving_pixels(mixture, points, velocity, spec, unambiguous_mps=unambiguous)
    return Seen(mixture, moving, velocity)


def fusion(options: argparse.Namespace, spec: ModelSpec) -> Callable[..., RangeImage]:
    """Return the function of what frames told, newest first, and their poses."""

    def fused(seen: tuple[Seen, ...], poses: Float[Array, "frame 4 4"]) -> RangeImage:
        frames = jax.tree.map(lambda *values: jnp.stack(values), *seen)
        return fuse(
            frames.mixture,
            poses,
            spec,
            moving=frames.moving,
            least_confidence=options.min_confidence,
        )

    return fused


class LastFrames:
    """The last frames of a recording, each with its place relative to the newest."""

    def __init__(self, recording: Recording, count: int):
        """`count` frames are kept, the newest included."""
        self._follower = Follower(recording, frames=count)
        self._seen = collections.deque[Seen](maxlen=count)
        self._count = count
        self.alone: list[int] = []  # frames that earlier ones could not be laid into

    def add(self, frame: int, seen: Seen) -> np.ndarray:
        """Add a frame; return the poses of all that are kept, newest first."""
        earlier = len(self._seen)
        self._seen.appendleft(seen)
        poses = self._follower.step(frame, np.asarray(seen.velocity))
        if earlier and not np.isfinite(poses[1:]).all():
            self.alone.append(frame)
        return poses

    def filled(self, poses: np.ndarray) -> tuple[tuple[Seen, ...], np.ndarray]:
        """Return as many frames and poses as are fused; NaN poses fill the rest up."""
        missing = self._count - len(self._seen)
        nothing = np.full((missing, 4, 4), np.nan)
        seen = (*self._seen, *[self._seen[0]] * missing)
        return seen, np.concatenate([poses, nothing]).astype(np.float32)

    def report(self) -> dict[str, Any]:
        """Return what told the motion, by the number of steps."""
        return {"frames fused": self._count, "motion by": dict(self._follower.steps)}

    def notes(self) -> Iterator[str]:
        """Yield a note about frames without known motion."""
        if self.alone:
            names = ", ".join(map(str, self.alone[:5])) + ", .." * (len(self.alone) > 5)
            yield (
                f"the radar's motion into frame {names} is not known: "
                f"fewer than {self._count} frames are fused there"
            )
