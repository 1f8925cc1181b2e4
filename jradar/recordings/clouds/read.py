"""Point clouds in files: PCD, PLY and KITTI. `outputs.clouds` writes PLY and PCD."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from jradar.errors import UsageError, parsing
from jradar.files import open_file
from jradar.recordings.clouds.pcd import (
    MAX_HEADER,
    binary_points,
    read_pcd,
    text_points,
)

MAX_BYTES = 4 << 30
KITTI = ("x", "y", "z", "intensity")
NUSCENES = (*KITTI, "ring")
MOST_RINGS = 256  # lasers of a LiDAR
PLY_TYPES = {
    **{"char": "i1", "short": "i2", "int": "i4", "float": "f4", "double": "f8"},
    **{"uchar": "u1", "ushort": "u2", "uint": "u4", "float32": "f4", "float64": "f8"},
    **{"int8": "i1", "int16": "i2", "int32": "i4"},
    **{"uint8": "u1", "uint16": "u2", "uint32": "u4"},
}
PLY_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


def read_cloud(path: Path | str) -> dict[str, np.ndarray]:
    """Return the columns of a .pcd, .ply or .bin file: x, y, z and its other fields.

    A .bin file is float32 [point, 4], x y z intensity, as in KITTI and ColoRadar, or
    [point, 5] with the laser's number, as in nuScenes. All points are kept, including
    missing returns. Raises ValueError if the file's size does not fit its header.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"no such cloud: {path}")
    readers = {".pcd": read_pcd, ".ply": read_ply, ".bin": _read_bin_columns}
    if path.suffix not in readers:
        raise UsageError(f"{path} is not a cloud, expected {', '.join(readers)}")
    with (
        open_file(path, limit=MAX_BYTES) as file,
        parsing(path, f"a {path.suffix} file of points"),
    ):
        columns = readers[path.suffix](file.read())
        if not {"x", "y", "z"} <= columns.keys():
            raise ValueError(f"it holds {[*columns]}, expected x, y and z")
    return columns


def read_bin(path: Path) -> Float[np.ndarray, "point 4"]:
    """Return the points of a .bin file, x y z intensity; an empty file holds none."""
    with (
        open_file(path, limit=MAX_BYTES) as file,
        parsing(path, "a .bin file of points"),
    ):
        return _table(file.read(), 4)


def _table(content: bytes, columns: int) -> Float[np.ndarray, "point column"]:
    if len(content) % (4 * columns):
        raise ValueError(
            f"it holds {len(content):,} bytes, expected a multiple of {4 * columns} "
            "(float32 x y z intensity): truncated?"
        )
    return np.frombuffer(content, "<f4").reshape(-1, columns).astype(np.float32)


def _read_bin_columns(content: bytes) -> dict[str, np.ndarray]:
    """Return four columns, or five if the fifth holds the numbers of lasers."""
    if content and len(content) % (4 * len(NUSCENES)) == 0:
        table = _table(content, len(NUSCENES))
        ring = table[:, -1]
        whole = (ring >= 0) & (ring < MOST_RINGS) & (ring == np.floor(ring))
        if whole.all() and ring.any():
            return dict(zip(NUSCENES, table.T, strict=True))
    return dict(zip(KITTI, _table(content, len(KITTI)).T, strict=True))


def read_ply(content: bytes) -> dict[str, np.ndarray]:
    """Return the columns of the vertices of a PLY file, with all their properties.

    The vertices come first, and hold numbers without lists, as in the files of all
    programs that write clouds. Errors are ValueError, KeyError or IndexError.
    """
    end = content.find(b"end_header", 0, MAX_HEADER)
    start = content.find(b"\n", end) + 1
    if not content.startswith(b"ply") or end < 0 or not start:
        raise ValueError("no header from `ply` to `end_header`")
    order, elements = _ply_header(content[:end].decode("ascii", "replace"))
    name, count, properties = elements[0]
    if name != "vertex" or any(kind[0] == "list" for kind, _ in properties):
        raise ValueError("expected vertices without lists as the first element")
    vertex = np.dtype([(name, order + PLY_TYPES[kind[0]]) for kind, name in properties])
    if not order:
        return text_points(content, start, vertex, count, more=len(elements) > 1)
    columns = binary_points(content, start, vertex, count)
    return {k: v.astype(v.dtype.newbyteorder("=")) for k, v in columns.items()}


def _ply_header(text: str) -> tuple[str, list[tuple[str, int, list]]]:
    """Return the byte order (empty for text); name, rows, properties of elements."""
    order, elements = None, []
    for line in text.splitlines():
        match line.split():
            case ["format", form, *_]:
                order = PLY_ORDERS[form]
            case ["element", name, count]:
                elements.append((name, int(count), []))
            case ["property", *kind, name]:
                elements[-1][2].append((kind, name))
    if order is None:
        raise ValueError("no line `format`")
    return order, elements
