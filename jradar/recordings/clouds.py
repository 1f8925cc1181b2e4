"""Point clouds in files: PCD, PLY and KITTI. `cloud_writers` writes them."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from jradar.errors import UsageError
from jradar.recordings.pcd import read_pcd
from jradar.recordings.ply import read_ply

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
