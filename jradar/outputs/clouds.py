"""Writes point clouds as PLY, PCD, CSV and NPZ; `recordings` reads PLY and PCD back.

A row is a valid point: x, y and z in metres, then what the cloud holds of velocity
(m/s), power and SNR. PLY and PCD are binary, float32, little-endian, and may hold notes
as comments; an NPZ file of `jradar enhance` holds them as texts named `verdict`. A CSV
file begins with the names, and its numbers read back as the same float32.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import jradar
from jradar.errors import UsageError, printable
from jradar.files import atomic_path


def valid_points(cloud: "jradar.PointCloud") -> dict[str, np.ndarray]:
    """Return `xyz` [point, 3] and the other measurements of a cloud's valid points."""
    valid = np.asarray(cloud.valid)
    measured = {k: v for k, v in cloud._asdict().items() if v is not None}
    del measured["valid"]
    return {k: np.asarray(v)[valid] for k, v in measured.items()}


def point_table(cloud: "jradar.PointCloud") -> np.ndarray:
    """Return the valid points as a structured array of float32: x, y, z, and the rest.

    A cloud's other fields keep their names; those that it lacks are left out.
    """
    columns = valid_points(cloud)
    xyz = columns.pop("xyz")
    columns = {**dict(zip("xyz", xyz.T, strict=True)), **columns}
    table = np.empty(len(xyz), [(name, "<f4") for name in columns])
    for name, column in columns.items():
        table[name] = column
    return table


def write_ply(
    path: Path | str, cloud: "jradar.PointCloud", notes: Sequence[str] = ()
) -> None:
    """Write the valid points of one cloud as a PLY file."""
    table = point_table(cloud)
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment jradar: metres, x forward, y left, z up",
        *(f"comment {printable(note)}" for note in notes),
        f"element vertex {len(table)}",
        *(f"property float {name}" for name in table.dtype.names or ()),
        "end_header",
    ]
    _write(path, header, table.tobytes())


def write_pcd(
    path: Path | str, cloud: "jradar.PointCloud", notes: Sequence[str] = ()
) -> None:
    """Write the valid points of one cloud as a PCD file of version 0.7."""
    table = point_table(cloud)
    names = table.dtype.names or ()
    header = [
        "# .PCD v0.7 - jradar: metres, x forward, y left, z up",
        *(f"# {printable(note)}" for note in notes),
        "VERSION 0.7",
        f"FIELDS {' '.join(names)}",
        f"SIZE {' '.join('4' for _ in names)}",
        f"TYPE {' '.join('F' for _ in names)}",
        f"COUNT {' '.join('1' for _ in names)}",
        f"WIDTH {len(table)}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(table)}",
        "DATA binary",
    ]
    _write(path, header, table.tobytes())


def write_csv(
    path: Path | str, cloud: "jradar.PointCloud", _notes: Sequence[str] = ()
) -> None:
    """Write the valid points of one cloud as lines of numbers with commas."""
    table = point_table(cloud)
    rows = (",".join(f"{number:.9g}" for number in row) for row in table.tolist())
    _write(path, [",".join(table.dtype.names or ()), *rows], b"")


CLOUD_WRITERS: dict[str, Callable[..., None]] = {  # path, cloud, notes
    "ply": write_ply,
    "pcd": write_pcd,
    "csv": write_csv,
}


def verdict_array(verdict: Sequence[str]) -> dict[str, np.ndarray]:
    """Return the texts on how far to trust a cloud, as NPZ files hold them."""
    return {"verdict": np.array(verdict, str)}


def write_npz(path: Path | str, arrays: dict[str, Any]) -> None:
    """Write named arrays as an NPZ file, uncompressed because that is much faster."""
    with atomic_path(path) as scratch, scratch.open("wb") as file:
        np.savez(file, **arrays)


def save_cloud(path: Path | str, cloud: "jradar.PointCloud") -> None:
    """Write the valid points of one cloud in the format that the suffix names.

    It is one of CLOUD_WRITERS or .npz. Raises UsageError for any other suffix.
    """
    kind = Path(path).suffix.removeprefix(".")
    jradar.types.check_one_cloud(cloud, "save")
    if kind == "npz":
        write_npz(path, valid_points(cloud))
    elif kind in CLOUD_WRITERS:
        CLOUD_WRITERS[kind](path, cloud)
    else:
        known = ", ".join(f".{name}" for name in (*CLOUD_WRITERS, "npz"))
        raise UsageError(f"{path}: expected a name that ends with one of {known}")


def _write(path: Path | str, lines: list[str], data: bytes) -> None:
    with atomic_path(path) as scratch:
        text = "\n".join([*lines, ""]).encode("ascii", "replace")
        scratch.write_bytes(text + data)
