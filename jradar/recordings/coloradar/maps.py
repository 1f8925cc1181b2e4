"""ColoRadar's radar and LiDAR maps, in patches around places of the robot.

RMap's patches (Mopidevi et al. 2023), as UpPoinTr publishes them: an octomap of a run's
single-chip CFAR clouds next to an octomap of its LiDAR scans, both of 0.15 m. A patch
holds the 2,048 radar and the 8,192 LiDAR voxels that are horizontally nearest to the
robot, so that it is an upright cylinder whose radius differs from patch to patch.

    ColoRadar/input/<run>_<patch>.pcd      radar voxels
    ColoRadar/gt/<run>_<patch>.pcd         LiDAR voxels

or one packed .npz a run: `radar_map` and `lidar_map` int16 [voxel, 3], `patch`, and
`radar_in_patch` and `lidar_in_patch`, bits along the voxels.
"""

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy  # loads `optimize` and `spatial` when they are first used
from jaxtyping import Float, Int16, UInt8

from jradar.errors import parsing
from jradar.files import check_unpacked
from jradar.recordings import read_cloud

VOXEL_M = 0.15
PATCH_VOXELS = 8192  # of the LiDAR in a patch
NAME = re.compile(r"(.+_run\d+)_(\d+)\.pcd")
MAX_BYTES = 1 << 30  # of the arrays in a packed file
MAX_CELL = 30_000  # of the number of a voxel along an axis
ARRAYS = ("radar_map", "lidar_map", "patch", "radar_in_patch", "lidar_in_patch")


class MapRun(NamedTuple):
    """Both maps of a run, as numbers of voxels, and bits of the voxels in patches."""

    name: str
    radar: Int16[np.ndarray, "voxel 3"]
    lidar: Int16[np.ndarray, "lidar_voxel 3"]
    radar_in_patch: UInt8[np.ndarray, "patch _"]
    lidar_in_patch: UInt8[np.ndarray, "patch _"]

    def __repr__(self) -> str:
        """Name and counts, in one line."""
        return (
            f"MapRun({self.name!r}, {len(self.radar_in_patch)} patches, "
            f"{len(self.radar)} radar and {len(self.lidar)} LiDAR voxels)"
        )

    @property
    def environment(self) -> str:
        """The name without the number of the run."""
        return self.name.rsplit("_run", 1)[0]

    def patch(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the radar and the LiDAR voxels of a patch."""
        maps, bits = self[1:3], self[3:5]
        return tuple(  # pyright: ignore[reportReturnType]
            voxels[np.unpackbits(rows[number], count=len(voxels)) > 0].astype(int)
            for voxels, rows in zip(maps, bits, strict=True)
        )

    def place(self, number: int) -> Float[np.ndarray, " 2"]:
        """Return x and y of the robot in a patch, in metres.

        A circle about the robot separates the columns of the patch from the others. The
        one of the widest margin follows from a linear program in its centre c and
        c^2 - r^2.
        """
        ours = np.unpackbits(self.lidar_in_patch[number], count=len(self.lidar)) > 0
        inside, outside = (
            (np.unique(self.lidar[mask][:, :2], axis=0) + 0.5) * VOXEL_M
            for mask in (ours, ~ours)
        )
        middle = (inside.min(0) + inside.max(0)) / 2
        hull = scipy.spatial.ConvexHull(inside).vertices
        inside, outside = inside[hull] - middle, outside - middle
        reach = np.linalg.norm(inside, axis=1).max() + 1.0
        outside = outside[np.linalg.norm(outside, axis=1) < reach]
        xy = np.concatenate([inside, outside])
        sign = np.repeat([1.0, -1.0], [len(inside), len(outside)])[:, None]
        squared = (xy**2).sum(1, keepdims=True)
        # sign (|p|^2 - 2 p c + c^2 - r^2) + margin <= 0
        rows = np.hstack([sign * np.hstack([-2 * xy, np.ones_like(squared)]), sign**2])
        found = scipy.optimize.linprog(
            [0, 0, 0, -1],
            A_ub=rows,
            b_ub=-(sign * squared)[:, 0],
            bounds=[(-reach, reach)] * 2 + [(None, None), (None, 1.0)],
        )
        return middle + found.x[:2]


def open_runs(path: Path | str) -> list[MapRun]:
    """Return the runs of a folder of packed files, or of a folder of PCD files.

    Raises FileNotFoundError without the folder, and ValueError for a folder without
    runs, for damaged files and for radar patches without a LiDAR patch.
    """
    path = Path(path)
    if not path.is_dir():
        raise FileNotFoundError(f"no such folder: {path}")
    if packed := sorted(path.glob("*.npz")):
        return [open_run(file) for file in packed]
    if (path / "input").is_dir() and (path / "gt").is_dir():
        return _loose(path)
    raise ValueError(
        f"{path} contains neither <run>.npz nor input/ and gt/: expected the folder "
        "ColoRadar of UpPoinTr, or packed runs"
    )


def open_run(path: Path) -> MapRun:
    """Return the run of a packed file; ValueError for a damaged one."""
    with parsing(path, f"a packed run with {', '.join(ARRAYS)}"):
        check_unpacked(path, limit=MAX_BYTES)
        with np.load(path, allow_pickle=False) as arrays:
            radar, lidar, _, *bits = (arrays[name] for name in ARRAYS)
        for voxels, packed in zip((radar, lidar), bits, strict=True):
            if voxels.dtype != np.int16 or voxels.ndim != 2 or voxels.shape[1] != 3:
                raise ValueError(f"a map is {voxels.dtype}{list(voxels.shape)}")
            if packed.dtype != np.uint8 or packed.shape[1:] != (-(-len(voxels) // 8),):
                raise ValueError(f"{len(voxels)} voxels, bits of {packed.shape}")
        if len(bits[0]) != len(bits[1]):
            raise ValueError("another number of radar than of LiDAR patches")
    return MapRun(path.stem, radar, lidar, *bits)


def _loose(folder):
    """The runs of a folder of PCD files, in the order of their names."""
    found = (NAME.fullmatch(file.name) for file in (folder / "input").iterdir())
    names = sorted((m[1], int(m[2]), m[0]) for m in found if m)
    if not names:
        raise ValueError(f"{folder / 'input'} contains no <run>_<patch>.pcd")
    missing = [name for *_, name in names if not (folder / "gt" / name).is_file()]
    if missing:
        raise ValueError(f"{folder / 'gt'} lacks {missing[0]}: incomplete download?")
    runs = []
    for run in dict.fromkeys(name for name, *_ in names):
        files = [file for name, _, file in names if name == run]
        maps = [
            _joined([_voxels(folder / kind / file) for file in files])
            for kind in ("input", "gt")
        ]
        (radar, radar_inside), (lidar, lidar_inside) = maps
        runs.append(MapRun(run, radar, lidar, radar_inside, lidar_inside))
    return runs


def _voxels(path):
    """The numbers of the voxels of a PCD file, whose points are their centres."""
    cloud = read_cloud(path)
    xyz = np.stack([cloud[axis] for axis in "xyz"], -1).astype(float)
    cells = xyz / VOXEL_M - 0.5
    numbers = np.rint(cells)
    with parsing(path, f"centres of voxels of {VOXEL_M} m"):
        if not np.isfinite(cells).all() or np.abs(cells).max(initial=0) > MAX_CELL:
            raise ValueError("points are not finite, or farther than 4.5 km")
        if np.abs(cells - numbers).max(initial=0) > 0.1:
            raise ValueError(f"points are not centres of voxels of {VOXEL_M} m")
    return numbers.astype(np.int16)


def _joined(patches):
    """The map that patches are parts of, and which voxels each has."""
    voxels, index = np.unique(np.concatenate(patches), axis=0, return_inverse=True)
    inside = np.zeros((len(patches), len(voxels)), bool)
    rows = np.repeat(np.arange(len(patches)), [len(patch) for patch in patches])
    inside[rows, index.ravel()] = True
    return voxels, np.packbits(inside, axis=1)
