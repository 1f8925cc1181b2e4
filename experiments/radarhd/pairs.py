"""RadarHD's pairs of polar images (Prabhakara et al. 2023), radar and LiDAR in a plane.

    dataset_5/train/radar/R_<trajectory>_<frame>.png     256 ranges x 64 azimuths
    dataset_5/train/lidar/L_<trajectory>_<frame>.png     256 ranges x 512 azimuths
    dataset_5/test/...

A simulated folder also has the points of the radar, in metres from it:

    runs/row/train/points/P_<trajectory>_<frame>.npz

Real pairs may also be a packed .npz with `radar` uint8, `lidar_packed` (bits along the
azimuth), `trajectory` and `frame`. Images are on the grids of
`jradar.model.grids.polar`.
"""

import functools
import hashlib
import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, UInt8

from jradar.data import Batch
from jradar.errors import parsing
from jradar.files import atomic_path, check_unpacked
from jradar.model.grids.polar import LIDAR, RADAR, PolarAxes
from jradar.outputs.clouds import write_npz

NAME = re.compile(r"R_(\d+)_(\d+)\.png")
MAX_BYTES = 4 << 30  # limit of the arrays in a packed file
MAX_POINTS_BYTES = 16 << 20  # and of one frame's points
MOST_CELLS = 20  # of the radar's azimuth in a rotation to either side, 57 degrees
MOST_SPEED = 2.0  # of a history, relative to its own; backwards below 0
MOST_SIZE = 1.8  # of a place, relative to its own; 1 / MOST_SIZE at least


class PolarPair(NamedTuple):
    """A radar image and the LiDAR occupancy at the same time."""

    radar: UInt8[np.ndarray, "range radar_azimuth"]
    lidar: Bool[np.ndarray, "range azimuth"]
    trajectory: int
    frame: int
    points: Float[np.ndarray, "point 3"] | None = None  # of the radar, if known


class RadarHD(Sequence):
    """Pairs in the order of trajectories and frames, read on access."""

    def __init__(
        self,
        keys: Any,
        radar: Callable[[int], Any],
        lidar: Callable[[int], Any],
        points: Callable[[int], Any] = lambda _: None,
    ):
        """`keys` are (trajectory, frame); `radar(i)` and `lidar(i)` return images.

        `points(i)` returns the radar's points, None if they are not known.
        """
        self.keys = np.asarray(keys).reshape(-1, 2)
        self.radar, self.lidar, self.points = radar, lidar, points

    @property
    def digest(self) -> str:
        """SHA-256 over the trajectories and frames of the pairs."""
        return hashlib.sha256(self.keys.astype("<i8").tobytes()).hexdigest()

    def __len__(self) -> int:
        return len(self.keys)

    def __getitem__(self, index: Any) -> Any:
        images = self.radar(index), self.lidar(index)
        return PolarPair(*images, *self.keys[index].tolist(), self.points(index))

    def of(self, trajectories: Sequence[int], *, without: bool = False) -> "RadarHD":
        """Return the pairs of trajectories, or those of all others.

        Raises ValueError for a missing one, unless it is to be left out.
        """
        known = set(self.keys[:, 0].tolist())
        missing = sorted(set(trajectories) - known)
        if missing and not without:
            raise ValueError(f"no trajectory {missing[0]}, expected of {sorted(known)}")
        chosen = np.isin(self.keys[:, 0], list(trajectories), invert=without)
        index = np.flatnonzero(chosen).tolist()
        return RadarHD(
            self.keys[index],
            lambda i: self.radar(index[i]),
            lambda i: self.lidar(index[i]),
            lambda i: self.points(index[i]),
        )

    def rotated(self, degrees: float) -> "RadarHD":
        """Return the pairs with both images rotated to the left by whole radar cells.

        They have no points. Raises ValueError for more than 90 degrees.
        """
        if not abs(degrees) <= 90:
            raise ValueError(f"{degrees:g} degrees, expected -90 to 90")
        cells = round(math.radians(degrees) / RADAR.azimuth_step)
        return RadarHD(
            self.keys,
            lambda i: rotated(self.radar(i), RADAR, cells),
            lambda i: rotated(self.lidar(i), LIDAR, cells),
        )

    def scaled(self, factor: float) -> "RadarHD":
        """Return the pairs of a place that is `factor` times as large.

        What is then beyond the range is lost, and so are the points. Raises ValueError
        for a factor outside 0.1 to 10.
        """
        if not 0.1 <= factor <= 10:
            raise ValueError(f"factor = {factor:g}, expected 0.1 to 10")
        return RadarHD(
            self.keys,
            lambda i: stretched(self.radar(i), factor),
            lambda i: moved_away(self.lidar(i), factor),
        )


class PolarItems(Sequence):
    """Pairs as the network takes them; with `mirror` followed by all mirror images.

    A condition consists of the last `history` radar images, newest first, of 0 to 1. A
    trajectory's first image also stands for those before it. A target is of 0 and 1.
    """

    def __init__(self, pairs: RadarHD, *, history: int, mirror: bool = False):
        self._pairs, self._history, self._mirror = pairs, history, mirror

    def __len__(self) -> int:
        return len(self._pairs) * (2 if self._mirror else 1)

    def __getitem__(self, index: Any) -> Batch:
        return self.at_speed(index, 1.0)

    def at_speed(self, index: Any, speed: float) -> Batch:
        """Return an item whose history passes at another speed.

        0 is a radar that stands still. Below 0 it moves backwards: the history then
        consists of the images that followed.
        """
        mirrored, i = divmod(int(index), len(self._pairs))
        trajectories = self._pairs.keys[:, 0]
        first, end = np.searchsorted(trajectories, trajectories[i] + [0, 1])
        steps = np.round(speed * np.arange(self._history)).astype(int)
        past = np.clip(i - steps, first, end - 1).tolist()
        radar = {k: self._pairs.radar(k) for k in set(past)}
        condition = np.stack([radar[k] for k in past], -1).astype(np.float32) / 255
        target = self._pairs.lidar(i).astype(np.float32)[..., None]
        if mirrored:
            condition, target = condition[:, ::-1], target[:, ::-1]
        return Batch(condition, target)

    def varied(self, index: Any, random: np.random.Generator) -> Batch:
        """Return an item as another drive, or another place, would show it.

        Every other history passes at another speed. The rest is `scaled_at_random` and
        `rotated_at_random`.
        """
        kind, speed = random.random(), random.uniform(-MOST_SPEED, MOST_SPEED)
        speed = 1.0 if kind < 0.5 else 0.0 if kind < 0.65 else speed
        item = scaled_at_random(self.at_speed(index, speed), random)
        return rotated_at_random(item, random)


class Alternating(Sequence):
    """Items of one sequence, each followed by one of another, which starts anew."""

    def __init__(self, first: PolarItems, second: PolarItems):
        self._both = first, second

    def __len__(self) -> int:
        return 2 * len(self._both[0])

    def __getitem__(self, index: Any) -> Batch:
        items, place = self._at(index)
        return items[place]

    def varied(self, index: Any, random: np.random.Generator) -> Batch:
        """Return an item as `PolarItems.varied` does."""
        items, place = self._at(index)
        return items.varied(place, random)

    def _at(self, index: Any) -> tuple[PolarItems, int]:
        place, odd = divmod(int(index), 2)
        first, second = self._both
        return (second, place % len(second)) if odd else (first, place)


def open_radarhd(path: Path | str, *, split: str = "train") -> RadarHD:
    """Return the pairs of the public folder's `split`, or of a packed training file.

    Radar images stay in memory once they are read, 16 KB each. Raises FileNotFoundError
    without `path`, and ValueError for a folder or file of another kind and for images
    without a partner.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"no such file or folder: {path}")
    if path.is_file():
        return _packed(path)
    folder = path / split
    if not (folder / "radar").is_dir() or not (folder / "lidar").is_dir():
        raise ValueError(
            f"{path} does not contain {split}/radar and {split}/lidar: expected "
            "RadarHD's folder dataset_5, or a packed .npz"
        )
    found = (NAME.fullmatch(p.name) for p in (folder / "radar").iterdir())
    keys = sorted((int(m[1]), int(m[2]), m[0][1:]) for m in found if m)
    lidar = {p.name[1:] for p in (folder / "lidar").glob("L_*_*.png")}
    alone = [name for *_, name in keys if name not in lidar]
    if alone or not keys:
        what = f"L{alone[0]}" if alone else "R_<trajectory>_<frame>.png"
        raise ValueError(f"{folder} does not contain {what}: incomplete download?")
    return RadarHD(
        [key[:2] for key in keys],
        # An image is part of many histories.
        functools.cache(lambda i: _png(folder / "radar" / f"R{keys[i][2]}", RADAR)),
        lambda i: _png(folder / "lidar" / f"L{keys[i][2]}", LIDAR) > 0,
        lambda i: _points(folder / "points" / f"P_{keys[i][0]}_{keys[i][1]}.npz"),
    )


def write_pair(folder: Path, pair: PolarPair) -> None:
    """Write a pair to the train part of a folder in RadarHD's layout.

    Its radar image appears when the pair is complete.
    """
    from PIL import Image

    name = f"P_{pair.trajectory}_{pair.frame}.npz"
    if pair.points is not None:
        write_npz(folder / "train" / "points" / name, {"xyz": pair.points})
    images = {"lidar": np.uint8(255) * pair.lidar, "radar": pair.radar}
    for kind, image in images.items():
        name = f"{kind[0].upper()}_{pair.trajectory}_{pair.frame}.png"
        path = folder / "train" / kind / name
        with atomic_path(path) as scratch:
            Image.fromarray(image).save(scratch, format="PNG")


def _points(path: Path) -> np.ndarray | None:
    """The points in a file that `write_pair` wrote, None without it."""
    if not path.is_file():
        return None
    with parsing(path, "a file of points"):
        check_unpacked(path, limit=MAX_POINTS_BYTES)
        with np.load(path, allow_pickle=False) as arrays:
            return arrays["xyz"].reshape(-1, 3).astype(np.float32)


def _packed(path: Path) -> RadarHD:
    """Pairs of a packed file, kept in memory."""
    with parsing(path, "a packed file with radar, lidar_packed, trajectory and frame"):
        check_unpacked(path, limit=MAX_BYTES)
        with np.load(path, allow_pickle=False) as arrays:
            radar, packed = arrays["radar"], arrays["lidar_packed"]
            keys = np.stack([arrays["trajectory"], arrays["frame"]], -1)
        if not radar.dtype == packed.dtype == np.uint8 or keys.dtype.kind not in "iu":
            raise ValueError("images are not bytes, or numbers not whole")
        found = radar.shape, (*packed.shape[:-1], 8 * packed.shape[-1])
        expected = (len(keys), *RADAR.shape), (len(keys), *LIDAR.shape)
        if found != expected:
            raise ValueError(f"images have shapes {found}, expected {expected}")
    order = np.lexsort(keys.T[::-1])
    return RadarHD(
        keys[order],
        lambda i: radar[order[i]],
        lambda i: np.unpackbits(packed[order[i]], axis=-1).astype(bool),
    )


def _png(path: Path, grid: PolarAxes) -> np.ndarray:
    """An 8-bit grey image on a grid."""
    from PIL import Image

    with parsing(path, "a complete PNG"):
        with Image.open(path, formats=("PNG",)) as image:
            if (found := (image.height, image.width)) != grid.shape:
                raise ValueError(f"{found} rows and columns, expected {grid.shape}")
            return np.asarray(image.convert("L"))


def rotated(image: np.ndarray, grid: PolarAxes, cells: int) -> np.ndarray:
    """Return a polar image [range, azimuth, ...] rotated to the left by radar cells.

    It moves by whole cells of its own. Beyond an edge, the view continues as its own
    mirror image, so that no part of it becomes empty.
    """
    last = len(grid.angles) - 1
    shift = round(cells * RADAR.azimuth_step / grid.azimuth_step)
    source = np.abs(np.arange(last + 1) - shift)
    return image[:, last - np.abs(last - source)]


def stretched(image: np.ndarray, factor: float) -> np.ndarray:
    """Return a polar image whose row r is row r / factor of the given one, or 0."""
    source = np.round(np.arange(len(image)) / factor).astype(int)
    inside = source < len(image)
    found = np.zeros_like(image)
    found[inside] = image[source[inside]]
    return found


def moved_away(occupied: np.ndarray, factor: float) -> np.ndarray:
    """Return polar occupancy whose pixels are `factor` times as far away."""
    row, *others = np.nonzero(occupied)
    target = np.round(row * factor).astype(int)
    inside = target < len(occupied)
    found = np.zeros_like(occupied)
    found[target[inside], *(other[inside] for other in others)] = True
    return found


def scaled_at_random(item: Batch, random: np.random.Generator) -> Batch:
    """Return every other item as of a place of another size."""
    if random.random() >= 0.5:
        return item
    factor = MOST_SIZE ** random.uniform(-1, 1)
    target = moved_away(item.target > 0, factor).astype(np.float32)
    return Batch(stretched(item.condition, factor), target)


def rotated_at_random(item: Batch, random: np.random.Generator) -> Batch:
    """Return every other item rotated about the radar, by whole radar cells."""
    if random.random() >= 0.5:
        return item
    cells = random.integers(-MOST_CELLS, MOST_CELLS + 1)
    return Batch(
        rotated(item.condition, RADAR, cells), rotated(item.target, LIDAR, cells)
    )
