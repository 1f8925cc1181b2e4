"""Sets whose frames are packed into one NPZ: they are known by their arrays."""

from collections.abc import Collection
from pathlib import Path

import numpy as np

from jradar.errors import parsing
from jradar.files import check_unpacked


def holds_arrays(path: Path, names: Collection[str]) -> bool:
    """True for a readable NPZ file with these arrays."""
    if path.suffix != ".npz" or not path.is_file():
        return False
    try:
        with parsing(path, "a .npz"), np.load(path, allow_pickle=False) as archive:
            return {*names} <= {*archive.files}
    except (OSError, ValueError):
        return False


def read_arrays(
    path: Path, names: Collection[str], *, limit: int
) -> dict[str, np.ndarray]:
    """Return arrays of a file that unpacks to at most `limit` bytes."""
    check_unpacked(path, limit=limit)
    with np.load(path, allow_pickle=False) as archive:
        return {name: archive[name] for name in names}
