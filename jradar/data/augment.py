"""Frames changed at random in training: other sizes of rooms, directions and echoes.

Radar points and LiDAR points change together, in space, as a place could: they are
mirrored left to right, rotated about the vertical axis, moved nearer or farther, or
reduced to one object. Radar points alone are left out at random, or replaced by true
ones: a network that sees perfect points must believe them.

What a rotated or smaller frame would show from beyond its old view is `Unknown`.
"""

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jradar.data.records import PreparedFrame

OBJECT_M = (0.5, 1.5)  # radius of the place that is left alone
ABOVE_DB = (15.0, 70.0)  # the strongest echo of that place above the noise
NOISE_SPREAD_DB = 0.4  # mean excess of the noise's points over its weakest
AT_ECHO = 0.4  # largest share of the noise in a ridge at that echo's range
RIDGE_DB = 3.0  # largest mean excess of a ridge
RIDGE_SPREAD = 0.2  # mean distance of its sines of azimuth from the echo's
FARTHEST_M = 15.0  # of noise


@dataclasses.dataclass(frozen=True)
class AugmentSpec:
    """How frames change; a spec without arguments changes nothing.

    Raises ValueError for probabilities outside 0 to 1, and for limits in wrong order.
    """

    mirror: bool = False  # every other frame, if the view is as wide to both sides
    thin: float = 0.0  # leave out up to this share of the radar points
    scale: tuple[float, float] = (1.0, 1.0)  # of all ranges, from and to
    rotation: float = 0.0  # up to this angle to either side, in radians
    alone: float = 0.0  # probability that all but one object vanish
    perfect: float = 0.0  # probability that true points replace the radar's

    def __post_init__(self):
        """Refuse values that cannot be used."""
        for name in ("thin", "alone", "perfect"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} = {getattr(self, name)}, expected 0 to 1")
        if not 0 < self.scale[0] <= self.scale[1] < math.inf:
            raise ValueError(f"scale = {self.scale}, expected 0 < lowest <= highest")
        if not 0 <= self.rotation < math.pi:
            raise ValueError(
                f"rotation = {self.rotation}, expected 0 to less than pi radians"
            )


class Unknown(NamedTuple):
    """What lies outside of the view that a changed frame was recorded with."""

    rotated: float = 0.0  # by this angle, in radians, to the left
    scaled: float = 1.0  # beyond this share of the greatest range

    def marked(
        self, image: Float[np.ndarray, "row column"], azimuth: tuple[float, float]
    ) -> Float[np.ndarray, "row column"]:
        """Return a LiDAR image with -1 where it is unknown what a scan would see.

        `azimuth` is the image's view in radians.
        """
        columns = image.shape[1]
        moved = round(self.rotated * columns / (azimuth[1] - azimuth[0]))
        hidden = np.zeros(columns, bool)
        hidden[: max(moved, 0)] = True
        hidden[columns + min(moved, 0) :] = True
        unseen = hidden | ((image == 0) & (self.scaled < 1))
        return np.where(unseen, np.float32(-1), image)


def augmented(
    frame: PreparedFrame, random: np.random.Generator, spec: AugmentSpec
) -> tuple[PreparedFrame, Unknown]:
    """Return the frame changed at random, and the part of it that is unknown."""
    unknown = Unknown()
    if random.random() < spec.alone:
        frame = alone(frame, random)
    if random.random() < spec.perfect:
        frame = with_true_points(frame, random)
    if spec.thin:
        kept = random.random(len(frame.radar.valid)) >= random.uniform(0, spec.thin)
        valid = np.asarray(frame.radar.valid) & kept
        frame = frame._replace(radar=frame.radar._replace(valid=valid))
    if spec.mirror and random.random() < 0.5:
        frame = moved(frame, np.diag([1.0, -1.0, 1.0]))
    if spec.rotation:
        angle = random.uniform(-spec.rotation, spec.rotation)
        cosine, sine = math.cos(angle), math.sin(angle)
        matrix = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        frame, unknown = moved(frame, matrix), unknown._replace(rotated=angle)
    if spec.scale != (1.0, 1.0):
        factor = math.exp(random.uniform(*np.log(spec.scale)))
        frame = moved(frame, factor * np.eye(3))
        unknown = unknown._replace(scaled=factor)
    return frame, unknown


def moved(frame: PreparedFrame, matrix: Float[np.ndarray, "3 3"]) -> PreparedFrame:
    """Return the frame whose radar and LiDAR points are multiplied by a matrix."""
    matrix = matrix.astype(np.float32)
    radar = frame.radar._replace(xyz=np.asarray(frame.radar.xyz) @ matrix.T)
    return frame._replace(radar=radar, lidar_xyz=frame.lidar_xyz @ matrix.T)


def alone(frame: PreparedFrame, random: np.random.Generator) -> PreparedFrame:
    """Return the frame with nothing but the points around a random LiDAR point.

    The other radar points become noise: at a false-alarm rate of 1, an empty place has
    as many points as a full one, in all directions and equally weak. The noise keeps
    its level; the echoes are scaled to a random level above it.

    Half of the frames have a ridge. Chirps start late at random, so a strong echo
    raises the noise at its own range. A corner reflector, for example, has about a
    quarter of the noise points at its range, most of them within 40 degrees of it and a
    few dB stronger than the others.
    """
    if not len(frame.lidar_xyz):
        return frame
    place = frame.lidar_xyz[random.integers(len(frame.lidar_xyz)), :2]
    radius = random.uniform(*OBJECT_M)

    def near(xyz):
        return np.linalg.norm(xyz[:, :2] - place, axis=1) < radius

    xyz, valid = np.asarray(frame.radar.xyz), np.asarray(frame.radar.valid)
    echo, count = near(xyz) & valid, len(valid)
    power = 1.0 if frame.radar.power is None else np.asarray(frame.radar.power)
    strongest = xyz[np.argmax(np.where(echo, power, -1.0))]
    noise, excess_db = _anywhere(count, random), random.exponential(1.0, count)
    level_db = np.full(count, NOISE_SPREAD_DB)
    if echo.any() and random.random() < 0.5:
        ridge = random.random(count) < random.uniform(0, AT_ECHO)
        noise[ridge] = _around(strongest, noise[ridge], random)
        level_db[ridge] = random.uniform(0, RIDGE_DB)
    radar = frame.radar._replace(xyz=np.where(echo[:, None], xyz, noise))
    if radar.power is not None and valid.any():
        floor = np.quantile(radar.power[valid], 0.05)
        above = 10 ** (random.uniform(*ABOVE_DB) / 10)
        scale = above * floor / np.max(radar.power, where=echo, initial=floor)
        weak = floor * 10 ** (level_db * excess_db / 10)
        power = np.where(echo, scale * radar.power, weak).astype(np.float32)
        radar = radar._replace(power=power)
    seen = frame.lidar_xyz[near(frame.lidar_xyz)]
    return frame._replace(radar=radar, lidar_xyz=seen)


def _anywhere(count, random):
    """Points in random directions to the front, at random ranges."""
    sine, elevation = random.uniform(-1, 1, count), random.uniform(-0.5, 0.5, count)
    range_m = random.uniform(0, FARTHEST_M, count)
    ahead = np.stack([np.sqrt(1 - sine**2), sine, np.tan(elevation)], -1)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    return (range_m[:, None] * ahead).astype(np.float32)


def _around(echo, noise, random):
    """Points of noise as far away as an echo, most of them near its direction."""
    range_m = np.linalg.norm(echo)
    sine = echo[1] / max(np.hypot(*echo[:2]), 1e-6)
    sine = sine + random.laplace(0, RIDGE_SPREAD, len(noise))
    sine = np.clip(sine, -0.99, 0.99)
    slope = noise[:, 2] / np.maximum(np.hypot(noise[:, 0], noise[:, 1]), 1e-6)
    ahead = np.stack([np.sqrt(1 - sine**2), sine, slope], -1)
    ahead *= range_m / np.linalg.norm(ahead, axis=1, keepdims=True)
    return ahead.astype(np.float32)


def with_true_points(
    frame: PreparedFrame, random: np.random.Generator
) -> PreparedFrame:
    """Return the frame with as many LiDAR points in place of its radar points."""
    places = np.flatnonzero(np.asarray(frame.radar.valid))
    count = min(len(places), len(frame.lidar_xyz))
    valid, xyz = np.zeros_like(frame.radar.valid), np.array(frame.radar.xyz)
    places = random.permutation(places)[:count]
    chosen = random.permutation(len(frame.lidar_xyz))[:count]
    xyz[places], valid[places] = frame.lidar_xyz[chosen], True
    return frame._replace(radar=frame.radar._replace(xyz=xyz, valid=valid))
