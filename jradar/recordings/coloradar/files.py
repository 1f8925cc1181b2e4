"""The kinds of files in ColoRadar's folders: streams, stamps, tables, transforms.

File N of a stream belongs to line N of its stamps. Lines are counted from 0, or from 1
if the file numbers begin with 1, as in ColoRadar+.
"""

import io
import math
import os
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Complex, Float

from jradar.errors import parsing
from jradar.files import read_text
from jradar.lidar import rigid_transform
from jradar.options.sensor import RadarSpec
from jradar.recordings.recording import Stream

MAX_TEXT_BYTES = 64 << 20
NANOSECONDS = 1e12  # larger stamps are nanoseconds, not seconds
FARTHEST_M = 5.0  # from the base to a sensor of a rig that is carried


def file_stream(
    folder: Path, prefix: str, stamps: Path, read: Callable[[Path], np.ndarray]
) -> Stream:
    """Return the stream of files `<prefix>_<N>.bin` in numeric order.

    The folder is listed, no file is opened. The stream's notes list gaps and stamps
    that do not fit. Raises ValueError if there are no files or two of one number.
    """
    found, notes = _numbered(folder, prefix), []
    numbers = np.array(sorted(found))
    first, last = numbers[[0, -1]].tolist()
    label = f"{folder.parent.parent.name}/{folder.parent.name}/{prefix}_<N>.bin"
    if missing := last - first + 1 - len(numbers):
        gap = first + int(np.argmax(np.diff(numbers) > 1)) + 1
        notes.append(
            f"{label}: {missing} of the numbers {first} to {last} are missing, "
            f"first {gap}"
        )
    times = None
    if stamps.is_file():
        times = read_stamps(stamps, notes)
        origin = 0 if first > 1 and len(times) > last else first
        if origin != first or first > 1:
            notes.append(
                f"{label}: the first number is {first}, taken as line "
                f"{first - origin + 1} of the stamps"
            )
        lines = numbers - origin
        stamped = lines < len(times)
        if unstamped := np.count_nonzero(~stamped):
            notes.append(
                f"{label}: {len(times)} stamps for {len(numbers)} files: "
                f"{unstamped} files without a stamp are left out"
            )
        if (spare := len(times) - 1 - int(lines[-1])) > 0:
            notes.append(
                f"{label}: the last {spare} of {len(times)} stamps have no file"
            )
        numbers, times = numbers[stamped], times[lines[stamped]]
    else:
        notes.append(f"{label}: no {stamps.name}, times are unknown")
    paths = [folder / found[number] for number in numbers.tolist()]
    return Stream(lambda item: read(paths[item]), len(paths), times, tuple(notes))


def _numbered(folder: Path, prefix: str) -> dict[int, str]:
    """Return the number and name of each of the stream's files."""
    found: dict[int, str] = {}
    names = sorted(os.listdir(folder)) if folder.is_dir() else []
    for name in names:
        if match := re.fullmatch(rf"{prefix}_([0-9]{{1,9}})\.bin", name):
            if (other := found.setdefault(int(match[1]), name)) != name:
                raise ValueError(
                    f"{folder} holds {other} and {name}, expected one of them"
                )
    if not found:
        what = f"{len(names)} other files" if folder.is_dir() else "no such folder"
        raise ValueError(f"no {prefix}_<N>.bin in {folder} ({what})")
    return found


def read_stamps(path: Path, notes: list[str]) -> Float[np.ndarray, " item"]:
    """Return stamps in seconds from a file of lines of seconds or of nanoseconds.

    Stamps that fall or repeat are reported in `notes`.
    """
    stamps = read_table(path, 1)[:, 0]
    if stamps.max() > NANOSECONDS:
        stamps = stamps * 1e-9
    label = f"{path.parent.parent.name}/{path.parent.name}/{path.name}"
    steps = np.diff(stamps)
    for wrong, what in ((steps < 0, "go back"), (steps == 0, "repeat the one before")):
        if count := np.count_nonzero(wrong):
            notes.append(f"{label}: {count} of {len(stamps)} stamps {what}")
    return stamps


def read_table(path: Path, columns: int) -> Float[np.ndarray, "row column"]:
    """Return finite numbers, `columns` per line; ValueError for any other file."""
    text = read_text(path, limit=MAX_TEXT_BYTES)
    if not text.strip():
        raise ValueError(f"{path} is empty, expected {columns} numbers per line")
    try:
        table = np.loadtxt(io.StringIO(text), ndmin=2, comments=None)
    except ValueError as error:
        raise ValueError(
            f"{path}: {error}, expected {columns} numbers per line"
        ) from None
    if table.shape[1] != columns or not len(table):
        raise ValueError(
            f"{path} has {table.shape[1]} numbers per line, expected {columns}"
        )
    if len(bad := np.flatnonzero(~np.isfinite(table).all(1))):
        raise ValueError(
            f"{path}: {len(bad)} lines contain NaN or infinite numbers, the first is "
            f"number {bad[0] + 1}"
        )
    return table


def read_stamped(
    folder: Path, name: str, columns: int, notes: list[str]
) -> tuple[Float[np.ndarray, " row"], Float[np.ndarray, "row column"]]:
    """Return the stamps of a folder, rising, and the rows of one of its files.

    Of several rows at one time the first is kept. Repairs go to `notes`.
    """
    stamps = read_stamps(folder / "timestamps.txt", notes)
    rows = read_table(folder / name, columns)
    count = min(len(stamps), len(rows))
    if len(stamps) != len(rows):
        notes.append(
            f"{folder.name}: {len(stamps)} stamps for {len(rows)} lines of {name}: "
            f"only the first {count} are used"
        )
    times, order = np.unique(stamps[:count], return_index=True)
    return times, rows[order]


def read_cube(
    path: Path, radar: RadarSpec
) -> Complex[np.ndarray, "tx rx chirp sample"]:
    """Return an ADC frame, int16 [tx][rx][chirp][sample][I, Q], as complex64."""
    size, needed = path.stat().st_size, 4 * math.prod(radar.cube_shape)
    if size != needed:
        tx, rx, chirps, samples = radar.cube_shape
        raise ValueError(
            f"{path} holds {size:,} bytes, {tx} tx x {rx} rx x {chirps} chirps x "
            f"{samples} samples x 2 halves of <i2 need {needed:,}: "
            f"{'truncated' if size < needed else 'from another configuration'}?"
        )
    halves = np.fromfile(path, "<i2").astype(np.float32)
    return halves.view(np.complex64).reshape(radar.cube_shape)


def read_transform(path: Path) -> Float[np.ndarray, "4 4"]:
    """Return the transform from sensor to base in a file: x y z, then qx qy qz qw."""
    with parsing(path, "a transform: x y z, then qx qy qz qw"):
        numbers = np.array(read_text(path).split(), float)
        if numbers.size != 7 or not np.isfinite(numbers).all():
            raise ValueError(f"{numbers.size} numbers, expected 7 finite ones")
    distance, length = np.linalg.norm(numbers[:3]), np.linalg.norm(numbers[3:])
    if abs(length - 1) > 0.01:
        raise ValueError(
            f"{path}: the quaternion {numbers[3:]} has length {length:.4g}, expected "
            "1: is the order x y z, then qx qy qz qw?"
        )
    if distance > FARTHEST_M:
        raise ValueError(
            f"{path}: the sensor lies {distance:.4g} m from the base, expected at most "
            f"{FARTHEST_M:g} m: are the numbers millimetres?"
        )
    return rigid_transform(numbers[:3], numbers[3:])
