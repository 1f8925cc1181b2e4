"""Trajectories in TUM's text format: a line `t x y z qx qy qz qw` per pose."""

from pathlib import Path

import numpy as np

from jradar.lidar import Poses

MAX_BYTES = 512 << 20


def read_tum(path: Path | str) -> Poses:
    """Return the poses in a TUM file; `#` begins a comment.

    Raises ValueError, with the line, for malformed lines and times that do not rise.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"no such file of poses: {path}")
    if (size := path.stat().st_size) > MAX_BYTES:
        raise ValueError(f"{path} holds {size:,} bytes, expected at most {MAX_BYTES:,}")
    rows, before = [], -np.inf
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, 1):
            words = line.split("#")[0].replace(",", " ").split()
            if not words:
                continue
            try:
                row = [float(word) for word in words]
            except ValueError:
                row = []
            length = sum(value * value for value in row[4:])
            if len(row) != 8 or not np.isfinite(row).all() or abs(length - 1) > 0.02:
                raise ValueError(
                    f"{path}, line {number}: {line.strip()!r}, expected 8 numbers: "
                    "t x y z and a quaternion qx qy qz qw of length 1"
                )
            if row[0] <= before:
                raise ValueError(
                    f"{path}, line {number}: time {row[0]} after {before}, expected "
                    "rising times"
                )
            rows.append(row)
            before = row[0]
    if len(rows) < 2:
        raise ValueError(f"{path} holds {len(rows)} poses, expected 2 or more")
    table = np.array(rows)
    return Poses(table[:, 0], table[:, 1:4], table[:, 4:])
