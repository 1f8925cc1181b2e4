"""Point clouds to files."""

from pathlib import Path
from typing import Any

import numpy as np

from jradar.files import atomic_path
from jradar.types import PointCloud


def valid_points(cloud: PointCloud) -> dict[str, np.ndarray]:
    """The valid points of one cloud: `xyz` [point, 3], and what else it measured."""
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

    trimesh's writer has no room for velocity and power, and none for an empty cloud.
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
