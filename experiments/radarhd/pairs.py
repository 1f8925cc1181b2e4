"""RadarHD's pairs of polar images (Prabhakara et al. 2023), radar and LiDAR in a plane.

    dataset_5/train/radar/R_<trajectory>_<frame>.png     256 ranges x 64 azimuths
    dataset_5/train/lidar/L_<trajectory>_<frame>.png     256 ranges x 512 azimuths
    dataset_5/test/...

or a packed .npz with `radar` uint8, `lidar_packed` (bits along the azimuth),
`trajectory` and `frame`. Row i stands for the i-th of evenly spaced ranges from 0 to
10.8 m, column j for the j-th of evenly spaced angles from -90 to 90 degrees, both ends
included.
"""

import dataclasses
import functools
import hashlib
import math
import re
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, UInt8

from jradar.errors import parsing

NAME = re.compile(r"R_(\d+)_(\d+)\.png")
MAX_BYTES = 4 << 30  # limit of the arrays in a packed file


@dataclasses.dataclass(frozen=True)
class PolarSpec:
    """The grid of polar images."""

    num_range: int = 256
    num_azimuth: int = 512
    max_range_m: float = 10.8
    azimuth: tuple[float, float] = (-math.pi / 2, math.pi / 2)

    @property
    def shape(self) -> tuple[int, int]:
        """The numbers of rows and columns."""
        return self.num_range, self.num_azimuth

    @functools.cached_property
    def ranges(self) -> Float[np.ndarray, " range"]:
        """The range of each row, in metres."""
        return np.linspace(0, self.max_range_m, self.num_range)

    @functools.cached_property
    def angles(self) -> Float[np.ndarray, " azimuth"]:
        """The azimuth of each column in radians, positive to the left."""
        return np.linspace(*self.azimuth, self.num_azimuth)

    @property
    def azimuth_step(self) -> float:
        """The angle between neighbouring columns, in radians."""
        return (self.azimuth[1] - self.azimuth[0]) / (self.num_azimuth - 1)


RADAR, LIDAR = PolarSpec(num_azimuth=64), PolarSpec()


class PolarPair(NamedTuple):
    """A radar image and the LiDAR occupancy at the same time."""

    radar: UInt8[np.ndarray, "range radar_azimuth"]
    lidar: Bool[np.ndarray, "range azimuth"]
    trajectory: int
    frame: int


def polar_to_points(
    occupied: Bool[np.ndarray, "range azimuth"],
) -> Float[np.ndarray, "point 3"]:
    """Return the points of the occupied pixels in the plane z = 0; on the host."""
    if occupied.shape != LIDAR.shape:
        raise ValueError(f"image has shape {occupied.shape}, expected {LIDAR.shape}")
    row, column = np.nonzero(occupied)
    distance, azimuth = LIDAR.ranges[row], LIDAR.angles[column]
    xyz = [distance * np.cos(azimuth), distance * np.sin(azimuth), 0 * distance]
    return np.stack(xyz, -1)


def turned(image: np.ndarray, grid: PolarSpec, angle: float) -> np.ndarray:
    """Return a polar image [range, azimuth, ...] turned to the left by `angle` (rad).

    It moves by whole cells. Beyond an edge, the view goes on as its own mirror image,
    so that no part of it becomes empty.
    """
    last = grid.num_azimuth - 1
    source = np.abs(np.arange(grid.num_azimuth) - round(angle / grid.azimuth_step))
    return image[:, last - np.abs(last - source)]


class RadarHD(Sequence):
    """Pairs in the order of trajectories and frames, read on access."""

    def __init__(self, keys, radar, lidar):
        """`keys` are (trajectory, frame); `radar(i)` and `lidar(i)` return images."""
        self.keys = np.asarray(keys).reshape(-1, 2)
        self._radar, self._lidar = radar, lidar

    @property
    def digest(self) -> str:
        """SHA-256 over the trajectories and frames of the pairs."""
        return hashlib.sha256(self.keys.astype("<i8").tobytes()).hexdigest()

    def __len__(self) -> int:
        return len(self.keys)

    def __getitem__(self, index: int | slice) -> Any:
        """Return pair `index`."""
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"pair {index} of {len(self)}")
        trajectory, frame = self.keys[index].tolist()
        i = index % len(self)
        return PolarPair(self._radar(i), self._lidar(i), trajectory, frame)

    def of(self, trajectories: Sequence[int]) -> "RadarHD":
        """Return the pairs of trajectories. Raises ValueError for a missing one."""
        known = set(self.keys[:, 0].tolist())
        if missing := sorted(set(trajectories) - known):
            raise ValueError(f"no trajectory {missing[0]}, expected of {sorted(known)}")
        return self._select(np.isin(self.keys[:, 0], list(trajectories)))

    def without(self, trajectories: Sequence[int]) -> "RadarHD":
        """Return the pairs of all other trajectories."""
        return self._select(~np.isin(self.keys[:, 0], list(trajectories)))

    def turned(self, degrees: float) -> "RadarHD":
        """Return the pairs with both images turned to the left by whole radar cells.

        Raises ValueError for more than 90 degrees.
        """
        if not abs(degrees) <= 90:
            raise ValueError(f"{degrees:g} degrees, expected -90 to 90")
        step = RADAR.azimuth_step
        angle = round(math.radians(degrees) / step) * step
        return RadarHD(
            self.keys,
            lambda i: turned(self._radar(i), RADAR, angle),
            lambda i: turned(self._lidar(i), LIDAR, angle),
        )

    def history(self, index: int, length: int) -> UInt8[np.ndarray, "..."]:
        """Return the last `length` radar images up to pair `index`, newest first.

        The axes are [range, radar_azimuth, image]. A trajectory's first image also
        stands for the images before it.
        """
        first = np.searchsorted(self.keys[:, 0], self.keys[index, 0])
        past = np.maximum(index - np.arange(length), first)
        images = {i: self._radar(i) for i in set(past.tolist())}
        return np.stack([images[i] for i in past.tolist()], -1)

    def _select(self, mask):
        """The pairs where `mask`."""
        index = np.flatnonzero(mask)
        return RadarHD(
            self.keys[index],
            lambda i: self._radar(int(index[i])),
            lambda i: self._lidar(int(index[i])),
        )


class PolarItem(NamedTuple):
    """A pair as the network takes it."""

    condition: Float[np.ndarray, "range radar_azimuth history"]  # 0 to 1
    target: Float[np.ndarray, "range azimuth 1"]  # 0 or 1


class PolarItems(Sequence):
    """Pairs as items; with `mirror` followed by all their mirror images."""

    def __init__(self, pairs: RadarHD, *, history: int, mirror: bool = False):
        """A condition consists of `history` radar images."""
        self._pairs, self._history, self._mirror = pairs, history, mirror

    def __len__(self) -> int:
        return len(self._pairs) * (2 if self._mirror else 1)

    def __getitem__(self, index: Any) -> Any:
        """Return item `index`."""
        mirrored, i = divmod(int(index), len(self._pairs))
        condition = self._pairs.history(i, self._history).astype(np.float32) / 255
        target = self._pairs[i].lidar.astype(np.float32)[..., None]
        if mirrored:
            condition, target = condition[:, ::-1], target[:, ::-1]
        return PolarItem(condition, target)


def open_radarhd(path: Path | str, *, split: str = "train") -> RadarHD:
    """Return the pairs of the public folder's `split`, or of a packed training file.

    Radar images stay in memory once they are read, 16 KB each.

    Raises FileNotFoundError without `path`, and ValueError for a folder or file of
    another kind and for images without a partner.
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

    @functools.cache  # an image is part of many histories
    def radar(i):
        return _read_png(folder / "radar" / f"R{keys[i][2]}", RADAR.shape)

    def lidar(i):
        return _read_png(folder / "lidar" / f"L{keys[i][2]}", LIDAR.shape) > 0

    return RadarHD([key[:2] for key in keys], radar, lidar)


def _packed(path: Path) -> RadarHD:
    """Pairs of a packed file, kept in memory."""
    what = "a packed file with radar, lidar_packed, trajectory and frame"
    with parsing(path, what):
        with zipfile.ZipFile(path) as archive:
            if (size := sum(m.file_size for m in archive.infolist())) > MAX_BYTES:
                raise ValueError(f"it unpacks to {size:,} bytes, limit {MAX_BYTES:,}")
        with np.load(path, allow_pickle=False) as arrays:
            radar, packed = arrays["radar"], arrays["lidar_packed"]
            keys = np.stack([arrays["trajectory"], arrays["frame"]], -1)
        if not radar.dtype == packed.dtype == np.uint8 or keys.dtype.kind not in "iu":
            raise ValueError("images are not bytes, or numbers not whole")
        shapes = radar.shape[1:], (*packed.shape[1:-1], 8 * packed.shape[-1])
    if shapes != (RADAR.shape, LIDAR.shape) or not len(radar) == len(packed) == len(
        keys
    ):
        raise ValueError(
            f"{path} contains images of {shapes}, expected {(RADAR.shape, LIDAR.shape)}"
        )
    order = np.lexsort(keys.T[::-1])

    return RadarHD(
        keys[order],
        lambda i: radar[order[i]],
        lambda i: np.unpackbits(packed[order[i]], axis=-1).astype(bool),
    )


def _read_png(path: Path, shape: tuple[int, int]) -> np.ndarray:
    """An 8-bit grey image of a known shape."""
    from PIL import Image

    with parsing(path, "a complete PNG"):
        with Image.open(path, formats=("PNG",)) as image:
            if (image.height, image.width) != shape:
                raise ValueError(
                    f"{path} has {image.height} x {image.width} pixels, expected "
                    f"{shape[0]} x {shape[1]}"
                )
            return np.asarray(image.convert("L"))
