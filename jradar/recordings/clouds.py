"""Point clouds in files: PCD, PLY and KITTI are read, PLY and NPZ are written."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from jradar.errors import UsageError
from jradar.files import atomic_path
from jradar.recordings.pcd import read_pcd
from jradar.recordings.ply import read_ply
from jradar.types import PointCloud

MAX_BIN_BYTES = 1 << 30


def read_cloud(path: Path | str) -> dict[str, np.ndarray]:
    """Return the columns of a .pcd, .ply or .bin file: x, y, z and its other fields.

    A .bin file is float32 [point, 4], x y z intensity, as in KITTI and ColoRadar. All
    points are kept, also missing returns. Raises ValueError if the file's size does not
    fit its header.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"no such cloud: {path}")
    readers = {".pcd": read_pcd, ".ply": read_ply, ".bin": _read_bin_columns}
    if path.suffix not in readers:
        raise UsageError(f"{path} is not a cloud, expected {', '.join(readers)}")
    columns = readers[path.suffix](path)
    if not {"x", "y", "z"} <= columns.keys():
        raise ValueError(f"{path} holds {[*columns]}, expected x, y and z")
    return columns


def read_bin(path: Path) -> Float[np.ndarray, "point 4"]:
    """Return the points of a .bin file, x y z intensity; an empty file holds none."""
    if (size := path.stat().st_size) % 16 or size > MAX_BIN_BYTES:
        raise ValueError(
            f"{path} holds {size:,} bytes, expected a multiple of 16 (float32 x y z "
            f"intensity), at most {MAX_BIN_BYTES:,}: truncated?"
        )
    return np.fromfile(path, "<f4").reshape(-1, 4).astype(np.float32, copy=False)


def _read_bin_columns(path):
    return dict(zip(("x", "y", "z", "intensity"), read_bin(path).T, strict=True))


def valid_points(cloud: PointCloud) -> dict[str, np.ndarray]:
    """Return `xyz` [point, 3] and the other measurements of a cloud's valid points."""
    valid = np.asarray(cloud.valid)
    measured = {k: v for k, v in cloud._asdict().items() if v is not None}
    del measured["valid"]
    return {k: np.asarray(v)[valid] for k, v in measured.items()}


def write_npz(path: Path | str, arrays: dict[str, Any]) -> None:
    """Write named arrays as a compressed NPZ file."""
    with atomic_path(path) as scratch, scratch.open("wb") as file:
        np.savez_compressed(file, **arrays)


def write_ply(path: Path | str, cloud: PointCloud) -> None:
    """Write the valid points of one cloud as binary PLY, all properties float32.

    Velocity, power and confidence become properties beside x, y and z.
    """
    columns = valid_points(cloud)
    xyz = columns.pop("xyz")
    columns = dict(zip("xyz", xyz.T, strict=True)) | columns
    table = np.stack([*columns.values()], -1).astype("<f4")
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment jradar: metres, x forward, y left, z up",
        f"element vertex {len(table)}",
        *(f"property float {name}" for name in columns),
        "end_header\n",
    ]
    with atomic_path(path) as scratch:
        scratch.write_bytes("\n".join(header).encode("ascii") + table.tobytes())
