"""Tables of points with named columns: PLY, PCD, CSV or NPZ, a file or a folder.

    frames/000123.ply ..       a folder holds a frame in each file
    walk.csv, walk.npz         a file holds a frame, or a column `frame` or `timestamp`
    walks/walk.csv ..          a folder of files of several frames holds recordings
    poses.txt, poses.npy       in the folder: TUM's format, or a 4 x 4 array a frame
    walk.tum, walk_poses.npy   beside a file

A table is a radar's if it has a Doppler velocity, an SNR, an RCS or a power, and no
confidence, which the clouds have that jradar draws. Poses are of the radar.
"""

import re
import textwrap
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jradar.errors import UsageError, parsing
from jradar.files import check_unpacked, open_file
from jradar.recordings.clouds.pcd import MAX_HEADER
from jradar.recordings.clouds.read import read_cloud
from jradar.recordings.points.fields import (
    OURS,
    are_points,
    are_radar_points,
    match_fields,
)
from jradar.recordings.points.frames import points_recording
from jradar.recordings.points.poses import found_poses
from jradar.recordings.recording import Format, Recording, Stream

SUFFIXES = (".ply", ".pcd", ".csv", ".npz")
MAX_BYTES = 2 << 30
FRAME = ("frame", "frame number", "frame_number", "frame_id", "frame_index", "scan")
TIME = ("timestamp", "time", "stamp", "stamp_s", "t", "time_s")
UNITS = ((1e11, 1.0), (1e14, 1e3), (1e17, 1e6), (np.inf, 1e9))  # of a time, by its size
LONGEST_FRAME_S = 1.0
SHOWN = 100  # letters of names of columns
EPOCH_S = 1e9  # a larger number in a file's name is a time


def open_tables(path: Path | str) -> Recording:
    """Open the frames of a file or folder; those of a folder are read on access.

    Raises ValueError for damaged files and for poses that do not fit the frames.
    """
    path = Path(path)
    frames = _folder(path) if path.is_dir() else _file(path)
    poses, stamps, notes = found_poses(path, len(frames), frames.stamps)
    frames = Stream(frames.__getitem__, len(frames), stamps, (*frames.notes, *notes))
    mount = None if poses is None else np.eye(4)
    name = path.resolve().name if path.is_dir() else path.stem
    return points_recording(path, frames, name=name, poses=poses, base_from_radar=mount)


def are_tables(path: Path) -> bool:
    """True for a file, or a folder of frames, whose columns are a radar's.

    A folder of files of several frames each is one of recordings.
    """
    files = _files(path) if path.is_dir() else [path]
    if not files or files[0].suffix not in SUFFIXES or not files[0].is_file():
        return False
    try:
        names = _names(files[0])
        several = path.is_dir() and _holds_several(files[0], names)
        return are_radar_points(names) and not several
    except (OSError, ValueError):
        return False


def _holds_several(path: Path, names: Iterable[str]) -> bool:
    """Whether a file holds several frames, by their numbers or their times.

    The points of one frame may differ a little in time.
    """
    plain = {name.lower() for name in names}
    if not plain & {*FRAME, *TIME}:
        return False
    frames = _file(path)
    apart = frames.stamps is not None and np.ptp(frames.stamps) > LONGEST_FRAME_S
    return len(frames) > 1 and (apart or not plain.isdisjoint(FRAME))


def refuse(path: Path) -> None:
    """Raise UsageError for a file of columns that are not a radar's; else do nothing.

    Raises ValueError for a damaged one.
    """
    if path.suffix not in SUFFIXES:
        return
    names = _names(path)
    shown = textwrap.shorten(", ".join(names), SHOWN, placeholder=" ..")
    if OURS in names:
        raise UsageError(
            f"{path} has the column {OURS}, as the clouds that jradar draws: expected "
            "points that a radar sent"
        )
    raise UsageError(
        f"{path} has {f'the columns {shown}' if shown else 'no columns'}, expected a "
        "radar's: x, y and z, or range and azimuth, with velocity, snr, rcs or power"
    )


READER = Format(
    "a radar's points as .ply, .pcd, .csv or .npz, or a folder of them, with columns "
    "x, y, z and velocity, snr, rcs or power",
    are_tables,
    open_tables,
)


def read_columns(path: Path) -> dict[str, np.ndarray]:
    """Return the columns of a file by name; ValueError for a damaged one."""
    if path.suffix in (".ply", ".pcd"):
        return {k: v for k, v in read_cloud(path).items() if v.ndim == 1}
    with open_file(path, limit=MAX_BYTES) as file, parsing(path, f"a {path.suffix}"):
        return _csv_columns(file) if path.suffix == ".csv" else _npz_columns(path)


def seconds(times: np.ndarray) -> Float[np.ndarray, " time"]:
    """Return times as seconds; their size says whether they are ms, us or ns."""
    times = np.asarray(times)
    largest = abs(times.astype(float)).max(initial=0.0)
    return times / next(unit for limit, unit in UNITS if largest < limit)


def _csv_columns(file) -> dict[str, np.ndarray]:
    head = file.readline(MAX_HEADER).decode("utf-8-sig")
    mark = next((m for m in ",;\t" if m in head), None)
    names = [name.strip(" \r\n\"'") for name in head.strip().split(mark)]
    start = file.tell()
    first = file.readline(MAX_HEADER).decode().strip().split(mark)
    file.seek(start)
    numeric = [k for k, cell in enumerate(first) if _is_number(cell)]
    if len(first) != len(names) and first != [""]:
        raise ValueError(f"{len(names)} names, but {len(first)} numbers in a row")
    if not numeric:
        return {name: np.zeros(0) for name in names}
    table = np.loadtxt(file, delimiter=mark, usecols=numeric, ndmin=2)
    return {names[k]: table[:, at] for at, k in enumerate(numeric)}


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _npz_columns(path: Path) -> dict[str, np.ndarray]:
    check_unpacked(path, limit=MAX_BYTES)
    with np.load(path, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    if "xyz" in arrays and arrays["xyz"].ndim == 2:
        arrays |= dict(zip("xyz", arrays.pop("xyz").T, strict=False))
    if "x" in arrays:
        size = arrays["x"].shape
        return {name: array for name, array in arrays.items() if array.shape == size}
    return {name: array for name, array in arrays.items() if array.ndim == 1}


def _names(path: Path) -> list[str]:
    """Return the names of the columns from the head of a file."""
    with open_file(path) as file:
        head = file.read(MAX_HEADER)
    if path.suffix == ".npz":
        with parsing(path, "a .npz"), np.load(path, allow_pickle=False) as archive:
            return [*("xyz" if "xyz" in archive.files else ""), *archive.files]
    if path.suffix == ".csv":
        line = head.decode("utf-8-sig", "replace").split("\n")[0]
        return [name.strip(" \r\"'") for name in re.split(r"[,;\t]", line)]
    text = head.decode("ascii", "replace")
    if path.suffix == ".pcd":
        fields = re.search(r"^FIELDS (.*)$", text, re.MULTILINE)
        return fields[1].split() if fields else []
    text = text.partition("end_header")[0].partition("element face")[0]
    return re.findall(r"^property \w+ (\w+)\s*$", text, re.MULTILINE)


def _files(folder: Path) -> list[Path]:
    """Return the files of the commonest kind in a folder, in the order of numbers."""
    shown = [p for p in folder.iterdir() if p.suffix in SUFFIXES and p.name[0] != "."]
    if not shown:
        return []
    ((suffix, _),) = Counter(path.suffix for path in shown).most_common(1)
    return sorted((p for p in shown if p.suffix == suffix), key=number_order)


def number_order(path: Path) -> list[tuple[int, str]]:
    """Return the key that sorts names by the numbers in them."""
    parts = re.findall(r"\d+|\D+", path.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


def _folder(path: Path) -> Stream:
    files = _files(path)

    def read(index: int) -> dict[str, np.ndarray]:
        columns = read_columns(files[index])
        if not are_points(match_fields(columns)):
            raise ValueError(
                f"{files[index]} has the columns {', '.join(columns) or 'none'}, "
                "expected x, y and z, or range and azimuth, as in the files next to it"
            )
        return columns

    return Stream(read, len(files), stamps_of_names(files))


def stamps_of_names(files: Iterable[Path]) -> Float[np.ndarray, " frame"] | None:
    """Return the times since 1970 with which the names of files end; None without."""
    numbers = []
    for path in files:
        parts = re.findall(r"\d+(?:\.\d+)?", path.stem)
        if not parts or float(parts[-1]) < EPOCH_S:
            return None
        numbers.append(float(parts[-1]) if "." in parts[-1] else int(parts[-1]))
    return seconds(np.array(numbers))


def _file(path: Path) -> Stream:
    """Return the frames of one file, by its column of frames or of times."""
    columns = read_columns(path)
    plain = {name.lower().strip(): name for name in columns}
    frame = next((plain[name] for name in FRAME if name in plain), None)
    time = next((plain[name] for name in TIME if name in plain), None)
    count = len(next(iter(columns.values()), ()))
    by = frame or time
    if by is None or not count:
        return Stream(lambda _: columns, 1)
    starts = np.flatnonzero(np.append(True, np.diff(columns[by]) != 0))
    if frame is None and len(starts) > count / 2:  # each point has its own time
        return Stream(lambda _: columns, 1)
    ends = np.append(starts[1:], count)

    def read(index: int) -> dict[str, np.ndarray]:
        rows = slice(starts[index], ends[index])
        return {name: column[rows] for name, column in columns.items()}

    stamps = None if time is None else seconds(columns[time][starts])
    return Stream(read, len(starts), stamps)
