"""A recording: radar frames and the data of other sensors, read when accessed.

Readers of every format return a `Recording`, and everything else works on it. A radar's
frames are samples, `cubes`, or the points that the radar itself found, or both. Fields
that a recording lacks are None, but `cubes`, which is then empty.

Four lists of formats drive this room, and `read` serves them all:

    open.READERS                  radar frames              -> Recording
    points.formats.READERS        points that a radar found -> Recording
    descriptions.DESCRIPTIONS     a radar's configuration   -> Description
    describe.CONTENTS             bags and clouds           -> what they hold

A new format is one file with a function that reads it, and one entry in a list.
"""

import logging
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
from jaxtyping import Float, Inexact, Int

import jradar
from jradar.errors import UsageError
from jradar.lidar import Poses, returns, transform

LOG = logging.getLogger(__name__)
OVERLAP_S = 0.05  # by which streams of one clock may miss one another
LOOKED_AT = 40  # frames of points that show whether there are elevations
TAKE_POINTS = "`jradar enhance`, `map`, `odometry`, `prepare`, `score` and `live`"


class Stream(Sequence):
    """The items of one sensor in recorded order; each is read when accessed."""

    def __init__(
        self,
        read: Callable[[int], Any],
        count: int,
        stamps: np.ndarray | None = None,
        notes: tuple[str, ...] = (),
    ):
        """`read(i)` returns item i of `count`; `stamps` are seconds, float64 [item].

        `notes` are repairs of the stream, and warnings about it.
        """
        if stamps is not None and len(stamps) != count:
            raise ValueError(
                f"{len(stamps)} stamps for {count} items, expected one each"
            )
        self.stamps, self.notes = stamps, notes
        self._read, self._count = read, count

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: int | slice) -> Any:
        """Item `index`, read from its file."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"item {index} of a stream of {len(self)} items")
        return self._read(index % len(self))


class Imu(NamedTuple):
    """Measurements at rising times, along the axes of the IMU."""

    stamps: Float[np.ndarray, " record"]  # seconds
    force: Float[np.ndarray, "record 3"]  # m/s^2, gravity's reaction included
    rate: Float[np.ndarray, "record 3"]  # rad/s


NO_CUBES = Stream([].__getitem__, 0)


class Recording(NamedTuple):
    """One sequence or capture. All transforms are 4 x 4 matrices in float64."""

    name: str  # of the sequence, which prepared records keep
    path: Path
    # None of points alone without a description: `need_samples` asks before its use.
    radar: "jradar.Radar" = cast(Any, None)
    cubes: Stream = NO_CUBES  # complex64 [tx, rx, chirp, sample], ADC counts
    points: Stream | None = None  # PointCloud of NumPy arrays, in the radar's frame
    lidar: Stream | None = None  # float32 [point, 4]: x y z intensity, LiDAR's frame
    poses: Poses | None = None  # of the base in the world
    imu: Imu | None = None
    base_from_radar: Float[np.ndarray, "4 4"] | None = None
    base_from_lidar: Float[np.ndarray, "4 4"] | None = None
    base_from_imu: Float[np.ndarray, "4 4"] | None = None
    lost_bytes: Int[np.ndarray, " frame"] | None = None  # zero-filled, per frame
    iq_order: str = ""  # of an adc_data.bin
    lanes: int = 0  # enabled, of an adc_data.bin whose lost samples were interpolated
    axes: tuple[str, ...] = ()  # of a .npy
    fields: tuple[tuple[str, str], ...] = ()  # what of the points was read from what
    notes: tuple[str, ...] = ()  # repairs and warnings

    def cube(self, frame: int) -> Inexact[np.ndarray, "tx rx chirp sample"]:
        """Return the samples of a frame as recorded; `radar` holds the calibration.

        Raises UsageError for a recording of points alone.
        """
        need_samples(self)
        return self.cubes[frame]

    @property
    def frames(self) -> Stream:
        """The radar's frames with their times: of samples, or else of points."""
        return self.cubes if self.points is None or len(self.cubes) else self.points

    @property
    def of_points(self) -> bool:
        """Whether the frames are points that the radar found, without samples."""
        return self.points is not None and not len(self.cubes)

    @property
    def has_elevation(self) -> bool:
        """Whether the array measures elevations, or points lie above or below it.

        Frames without a point do not say that it does not.
        """
        if self.radar is not None:
            return self.radar.spec.has_elevation
        if not (count := len(self.frames)):
            return True
        chosen = np.linspace(0, count - 1, min(count, LOOKED_AT)).round().astype(int)
        heights = np.concatenate([self.frames[k].xyz[:, 2] for k in chosen.tolist()])
        return bool(heights.any()) or not len(heights)

    @property
    def frame_middle_s(self) -> float:
        """The time from a frame's stamp to its middle; 0 for points."""
        return 0.0 if self.of_points else self.radar.spec.frame_middle_s

    @property
    def frame_period_s(self) -> float:
        """The described time from frame to frame, 0 if it is not known."""
        return 0.0 if self.radar is None else self.radar.spec.frame_period_s

    def __repr__(self) -> str:
        """One line: name, frames, radar, and what else was recorded."""
        others = ("lidar", "poses", "imu")
        known = [name for name in others if getattr(self, name) is not None]
        more = f", with {', '.join(known)}" if known else ""
        frames = f"{len(self.frames)} frames"
        if not len(self.cubes):
            return f"Recording({self.name!r}, {frames} of points{more})"
        return f"Recording({self.name!r}, {frames}{more}, {self.radar})"


def need_samples(recording: Recording) -> None:
    """Raise UsageError for a recording of the points that a radar found."""
    if recording.of_points:
        raise UsageError(
            f"{recording.path} holds a radar's points, expected its raw samples: "
            f"{TAKE_POINTS} take points"
        )


def radar_from_lidar(recording: Recording) -> Float[np.ndarray, "4 4"] | None:
    """Return the transform of LiDAR points to the radar's frame; None if unknown."""
    if recording.base_from_radar is None or recording.base_from_lidar is None:
        return None
    return np.linalg.inv(recording.base_from_radar) @ recording.base_from_lidar


def nearest_scan(
    recording: Recording, frame: int, *, tolerance_s: float = 0.05
) -> Float[np.ndarray, "point 3"] | None:
    """Return the LiDAR scan nearest in time to a frame, in the radar's frame.

    Missing returns, points at (0, 0, 0), are removed. Returns None if no scan lies
    within `tolerance_s`, or if times or transforms are unknown.
    """
    stamps, lidar = recording.frames.stamps, recording.lidar
    move = radar_from_lidar(recording)
    if lidar is None or move is None or not len(lidar):
        return None
    if stamps is None or lidar.stamps is None:
        return None
    apart = np.abs(lidar.stamps - stamps[frame])
    if apart.min() > tolerance_s:
        return None
    xyz = lidar[int(apart.argmin())][:, :3]
    return transform(move, xyz[returns(xyz)])


def clocks_apart(
    radar: Float[np.ndarray, " frame"], other: Float[np.ndarray, " item"]
) -> str:
    """Return the spans of two streams in words if they do not overlap, else ""."""
    if not len(radar) or not len(other):
        return ""
    (first, last), (begin, end) = ((s.min(), s.max()) for s in (radar, other))
    if max(begin - last, first - end) <= OVERLAP_S:
        return ""
    return f"{first:.3f} to {last:.3f} s against {begin:.3f} to {end:.3f} s"


def loss_notes(lost_bytes: Int[np.ndarray, " frame"]) -> tuple[str, ...]:
    """Return a note on the frames of a live radar that lost bytes, if there are any."""
    damaged, count = int((lost_bytes > 0).sum()), len(lost_bytes)
    note = f"{damaged} of {count} frames lost bytes, which are read as zeros"
    return (note,) if damaged else ()


class Format(NamedTuple):
    """One kind of file or folder."""

    name: str  # in error messages, such as "a .npy cube with its .toml"
    matches: Callable[[Path], bool]
    open: Callable[..., Any]
    options: tuple[str, ...] = ()  # that `open` takes after the path


def read(path: Path, formats: Sequence[Format], **options: Any) -> Any:
    """Read `path` by the first of `formats` that matches it.

    Options that are None count as not given. Raises UsageError if no format matches,
    and for an option that the matching format does not take.
    """
    found = next((known for known in formats if known.matches(path)), None)
    if found is None:
        names = "; ".join(known.name for known in formats)
        raise UsageError(f"{path} is of no known format, expected {names}")
    given = {k: v for k, v in options.items() if v is not None}
    for option, value in given.items():
        if option not in found.options:
            takers = [known.name for known in formats if option in known.options]
            raise UsageError(
                f"{option} = {value!r} does not apply to {path}, {found.name}; it is "
                f"an option of {'; '.join(takers) or 'no format'}: leave it out"
            )
    LOG.info("%s is read as %s", path, found.name)
    return found.open(path, **given)
