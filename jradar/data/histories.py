"""Points of the last frames as one condition, as different radars would send them.

Records of walks hold the cells of each frame and the pose of the radar. So a condition
can be drawn whose points are those of several frames, and of any detector: all
weak cells of a capture card, or the few points that a radar's own chip sends.

    Records --histories--> History --drawn(random)--> PreparedFrame

The frame's LiDAR stays that of the present. The earlier points are moved into the
present frame, each with its age, and those of things that move are left out, as
`jradar.pipeline.LastPoints` does it. Their motion may have errors, as it has without
poses.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jradar.data.records import PreparedFrame, Records, cells_of
from jradar.radar import PointSpec, Radar, RadarSpec, cell_points, detect
from jradar.recordings.recording import Stream
from jradar.types import SIZES, PointCloud

# What chips run: detector, false-alarm rate, and whether one cell of a peak is kept.
CHIPS = (
    ("so", 1e-3, True),
    ("so", 1e-6, True),
    ("ca", 1e-4, True),
    ("go", 1e-2, True),
    ("os", 1e-3, False),
    ("ca", 1e-6, False),
)
MOST_SENT = 24, 600  # points of a frame: limits of chips
STEP_M = 1 / 128, 0.06  # to which coordinates are rounded
MOVES_MPS = 0.15  # by which the velocity of something that moves differs
DRIFT_MPS, DRIFT_RAD_PER_S = (0.05, 0.05, 0.02), math.radians(1.0)  # rms
MOST_POINTS = SIZES[2]  # of all frames; the newest are kept


@dataclasses.dataclass(frozen=True)
class HistorySpec:
    """How conditions are drawn; a spec without arguments changes nothing.

    Raises ValueError for probabilities outside 0 to 1, and for less than one frame.
    """

    frames: int = 1  # of a condition, at most
    single: float = 0.35  # probability of one frame alone
    sparse: float = 0.0  # probability of the points of a chip
    drift: float = 0.0  # probability that the motion has errors

    def __post_init__(self):
        """Refuse values that cannot be used."""
        if self.frames < 1:
            raise ValueError(f"frames = {self.frames}, expected 1 or more")
        for name in ("single", "sparse", "drift"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} = {getattr(self, name)}, expected 0 to 1")


class Sender(NamedTuple):
    """How a radar turns cells into the points that it sends."""

    points: PointSpec | None = None  # None: those of the record
    most: int = MOST_POINTS  # points of a frame, the strongest
    step_m: float = 0.0  # of coordinates; 0: not rounded
    moving_only: bool = False  # static clutter is removed
    with_power: bool = True

    @classmethod
    def drawn(cls, random: np.random.Generator, sparse: float) -> "Sender":
        """Return a chip with the probability `sparse`, else a capture card."""
        if random.random() >= sparse:
            return cls()
        detector, rate, peaks = CHIPS[random.integers(len(CHIPS))]
        return cls(
            PointSpec(detector=detector, false_alarm_rate=rate, group_peaks=peaks),
            most=round(math.exp(random.uniform(*np.log(MOST_SENT)))),
            step_m=random.uniform(*STEP_M) if random.random() < 0.5 else 0.0,
            moving_only=random.random() < 0.1,
            with_power=random.random() < 0.7,
        )

    def sent(self, records: Records, frame: PreparedFrame) -> PointCloud:
        """Return the points of a frame, all valid, the strongest first; host."""
        radar = records.radar_of(frame.sequence)
        cloud = frame.radar
        if self.points is not None:
            cloud = _detected(records, frame, radar, self.points)
        kept = np.asarray(cloud.valid).copy()
        if self.moving_only:
            kept &= np.abs(np.asarray(cloud.velocity)) > radar.velocity_resolution_mps
        kept = np.flatnonzero(kept)[: self.most]
        xyz = np.asarray(cloud.xyz, np.float32)[kept]
        if self.step_m:
            xyz = np.float32(self.step_m * np.round(xyz / self.step_m))
        power = np.ones(len(xyz), np.float32)
        if self.with_power:
            power = np.asarray(cloud.power, np.float32)[kept]
        velocity = np.asarray(cloud.velocity, np.float32)[kept]
        return PointCloud(xyz, np.ones(len(xyz), bool), velocity, power)


class History(NamedTuple):
    """A frame of records, and how its condition is drawn."""

    records: Records
    index: int
    spec: HistorySpec

    def drawn(self, random: np.random.Generator) -> PreparedFrame:
        """Return the frame with the points of frames up to it; host."""
        sender, count = Sender.drawn(random, self.spec.sparse), 1
        if random.random() >= self.spec.single and self.spec.frames > 1:
            count = int(random.integers(2, self.spec.frames + 1))
        drift = random.random() < self.spec.drift
        errors = random.normal(size=4) * (*DRIFT_MPS, DRIFT_RAD_PER_S) * drift
        return self.of(sender, count, errors.tolist())

    def of(
        self,
        sender: Sender,
        count: int,
        errors: Sequence[float] = (0.0, 0.0, 0.0, 0.0),
    ) -> PreparedFrame:
        """Return the frame with the points of `count` frames, as a sender sends them.

        `errors` are those of the estimated motion: m/s along the axes, rad/s of yaw.
        """
        present = self.records[self.index]
        if count == 1 and sender == Sender():
            return present
        parts = [_aged(sender.sent(self.records, present), 0.0)]
        for frame, speed in self._earlier(present, count - 1):
            points = sender.sent(self.records, frame)
            age = present.stamp - frame.stamp
            limit = self.records.radar_of(frame.sequence).max_velocity_mps
            still = _still(points, speed, limit)
            turn, shift = _moved(present, frame, age, errors)
            xyz = np.float32(points.xyz[still] @ turn.T + shift)
            parts.append(_aged(_some(points, still)._replace(xyz=xyz), age))
        columns: Any = zip(*parts, strict=True)
        joined = (None if c[0] is None else np.concatenate(c) for c in columns)
        newest: Any = (None if c is None else c[:MOST_POINTS] for c in joined)
        return present._replace(radar=PointCloud(*newest).padded())

    def _earlier(self, present, count):
        """Yield earlier frames of the sequence, newest first, and the radar's velocity.

        The velocity is in the frame of the radar then.
        """
        name, later = self.records.where[self.index][0], present
        for index in range(self.index - 1, max(self.index - 1 - count, -1), -1):
            if self.records.where[index][0] != name:
                return
            frame = self.records[index]
            seconds = later.stamp - frame.stamp
            step = later.world_from_radar[:3, 3] - frame.world_from_radar[:3, 3]
            if not np.isfinite(step).all() or not seconds > 0:
                return
            yield frame, frame.world_from_radar[:3, :3].T @ step / seconds
            later = frame


def histories(records: Records, spec: HistorySpec) -> Stream:
    """Return a `History` for each frame of the records."""
    return Stream(lambda index: History(records, index, spec), len(records))


def fixed_histories(records: Records, spec: HistorySpec, *, seed: int = 0) -> Stream:
    """Return each frame with a history that was drawn once; to validate with."""

    def frame(index):
        random = np.random.default_rng([seed, index])
        return History(records, index, spec).drawn(random)

    return Stream(frame, len(records))


def _detected(
    records: Records, frame: PreparedFrame, radar: RadarSpec, points: PointSpec
) -> PointCloud:
    """Return the points that a detector finds in the cells of a frame."""
    doppler, range_ = records.windows_of(frame.sequence)
    points = dataclasses.replace(points, doppler_window=doppler, range_window=range_)
    points = points.fitted(radar)
    cells = cells_of(frame)
    mask = detect(cells.power, radar, points=points)
    unit = Radar(radar, range_bias_m=frame.range_bias_m)
    return cell_points(cells, mask, unit, points=points)


def _still(
    points: PointCloud, speed: Float[np.ndarray, " 3"], limit_mps: float
) -> Bool[np.ndarray, " point"]:
    """Return which points have the velocity of something that stands still."""
    away = np.linalg.norm(points.xyz, axis=1, keepdims=True)
    apart = points.velocity + (points.xyz / np.maximum(away, 1e-6)) @ speed
    folded = (apart + limit_mps) % (2 * limit_mps) - limit_mps
    return np.abs(folded) < MOVES_MPS


def _moved(present, frame, age, errors):
    """Return rotation and shift from an earlier frame to the present, with errors."""
    pose = np.linalg.inv(present.world_from_radar) @ frame.world_from_radar
    cosine, sine = math.cos(errors[3] * age), math.sin(errors[3] * age)
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    shift = turn @ pose[:3, 3] + np.multiply(errors[:3], age)
    return turn @ pose[:3, :3], shift


def _aged(points: PointCloud, age: float) -> PointCloud:
    return points._replace(age=np.full(len(points.xyz), age, np.float32))


def _some(points: PointCloud, chosen: Bool[np.ndarray, " point"]) -> PointCloud:
    columns: Any = (None if c is None else c[chosen] for c in points)
    return PointCloud(*columns)
