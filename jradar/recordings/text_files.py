"""Text files: as TOML, as a radar, as a trajectory."""

import dataclasses
import difflib
import logging
import tomllib
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from jradar.errors import UsageError, parsing
from jradar.files import read_text
from jradar.lidar import Poses
from jradar.options.sensor import RadarSpec

LOG = logging.getLogger(__name__)
MAX_POSES_BYTES = 512 << 20


def toml(path: Path | str) -> dict[str, Any]:
    """Return the tables of a TOML file; UsageError for a file of another kind."""
    try:
        with parsing(path, "a TOML file"):
            return tomllib.loads(read_text(path))
    except ValueError as error:
        raise UsageError(str(error)) from error


def check_names(
    path: Path | str, what: str, given: Iterable[str], names: Collection[str]
) -> None:
    """Raise UsageError for the first unknown name, with the nearest known one."""
    for name in given:
        if name not in names:
            near = difflib.get_close_matches(str(name), names, 1) or [", ".join(names)]
            raise UsageError(f"{path}: unknown {what} {name!r}, expected {near[0]}")


def radar_of(path: Path | str, values: dict[str, Any]) -> RadarSpec:
    """Return the radar with these fields; errors name the file they come from."""
    try:
        radar = RadarSpec.from_dict(values)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    if "device" in values:
        names = [f.name for f in dataclasses.fields(radar) if f.name not in values]
        text = "%s does not hold %s: the board %s has its own, or the default is taken"
        LOG.info(text, path, ", ".join(names), values["device"])
    return radar


def read_frame_times(
    path: Path | str,
) -> tuple[Float[np.ndarray, " frame"], Int[np.ndarray, " frame"]]:
    """Return time (s) and lost bytes of each frame, from lines of both.

    A last line that was not finished is left out. Raises ValueError, with the line,
    unless a line holds two numbers.
    """
    rows = []
    text = read_text(path, limit=MAX_POSES_BYTES)
    for number, line in enumerate(text.splitlines(keepends=True), 1):
        if not line.endswith("\n"):
            break
        try:
            time, lost = line.split()
            rows.append((float(time), int(lost)))
        except ValueError:
            raise ValueError(
                f"{path}, line {number}: {line.strip()!r:.80}, expected the time of a "
                "frame in seconds and its lost bytes"
            ) from None
    times, lost = zip(*rows, strict=True) if rows else ((), ())
    return np.array(times, float), np.array(lost, int)


def read_tum(path: Path | str) -> Poses:
    """Return the poses in a file in TUM's format, a line `t x y z qx qy qz qw` each.

    `#` begins a comment. Raises ValueError, with the line, for malformed lines and
    times that do not rise.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"no such file of poses: {path}")
    rows, before = [], -np.inf
    text = read_text(path, errors="replace", limit=MAX_POSES_BYTES)
    for number, line in enumerate(text.splitlines(), 1):
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
                f"{path}, line {number}: {line.strip()!r}, expected 8 numbers: t x y z "
                "and a quaternion qx qy qz qw of length 1"
            )
        if row[0] <= before:
            raise ValueError(
                f"{path}, line {number}: time {row[0]} after {before}, expected rising "
                "times"
            )
        rows.append(row)
        before = row[0]
    if len(rows) < 2:
        raise ValueError(f"{path} holds {len(rows)} poses, expected 2 or more")
    table = np.array(rows)
    return Poses(table[:, 0], table[:, 1:4], table[:, 4:])
