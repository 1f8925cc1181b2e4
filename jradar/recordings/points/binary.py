"""Points as float32 without names: View-of-Delft's and TJ4DRadSet's radar `.bin`.

    View-of-Delft    [point][7]   x y z RCS v_r v_r_compensated scan
    TJ4DRadSet       [point][8]   X Y Z V_r Range Power Alpha Beta

What the columns hold says which it is: a range that is the length of x y z, or scans
counted 0, -1, -2 back. Both have x forward, y left, z up, and velocities that are
negative when a target approaches. A folder is a recording; neither set has times.
"""

import re
from pathlib import Path

import numpy as np

from jradar.errors import parsing
from jradar.files import open_file
from jradar.recordings.points.frames import points_recording
from jradar.recordings.points.tables import number_order, stamps_of_names
from jradar.recordings.recording import Format, Recording, Stream

MAX_BYTES = 64 << 20  # two million points
DELFT = ("x", "y", "z", "rcs", "v_r", "v_r_compensated", "scan")
TJ4D = ("x", "y", "z", "v_r", "range", "power", "alpha", "beta")
MOST_SCANS = 10
NEAR, FAR = 0.01, 1e4  # metres, of a radar's points: other numbers are others' files
BEGIN_BYTES = 4 * len(TJ4D) * len(DELFT) * 16  # whole points of either set
NAME = re.compile(r"\d+\.bin")


def open_binary(path: Path | str) -> Recording:
    """Open a file, or a folder of them, of either set."""
    path = Path(path)
    files, layout = _files(path), ()
    for file in files:  # of frames that hold points
        if file.stat().st_size:
            layout = _layout(file)
            break
    frames = Stream(
        lambda k: _read(files[k], layout), len(files), stamps_of_names(files)
    )
    name = path.resolve().name if path.is_dir() else path.stem
    fields = {q: q for q in ("x", "y", "z")} | {"velocity": "v_r"}
    fields["power"] = "rcs" if layout == DELFT else "power"
    return points_recording(path, frames, name=name, fields=fields, forward="x")


def is_binary(path: Path) -> bool:
    """True for files of either set, by the contents of the first one."""
    try:
        files = _files(path)
        return bool(files) and bool(_layout(files[0]))
    except (OSError, ValueError):
        return False


READER = Format(
    "radar points of View-of-Delft or TJ4DRadSet, a .bin or a folder of them",
    is_binary,
    open_binary,
)


def _files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path] if path.suffix == ".bin" and path.is_file() else []
    found = (file for file in path.iterdir() if NAME.fullmatch(file.name))
    return sorted(found, key=number_order)


def _layout(file: Path) -> tuple[str, ...]:
    """Return the columns of a file by its first points, () if it is of neither set."""
    size = file.stat().st_size
    with open_file(file, limit=MAX_BYTES) as opened:
        words = np.frombuffer(opened.read(BEGIN_BYTES), "<f4")
    for names in (TJ4D, DELFT):
        if not words.size or size % (4 * len(names)):
            continue
        table = words.reshape(-1, len(names))
        if not np.isfinite(table).all():
            continue
        length = np.linalg.norm(table[:, :3].astype(float), axis=1)
        if not ((length > NEAR) & (length < FAR)).all():
            continue
        distance = table[:, TJ4D.index("range")]
        if names == TJ4D and np.allclose(length, distance, rtol=1e-3, atol=0):
            return TJ4D
        if names == DELFT and np.isin(table[:, -1], -np.arange(MOST_SCANS)).all():
            return DELFT
    return ()


def _read(file: Path, layout: tuple[str, ...]) -> dict[str, np.ndarray]:
    with open_file(file, limit=MAX_BYTES) as opened, parsing(file, "a .bin of points"):
        table = np.frombuffer(opened.read(), "<f4").reshape(-1, len(layout))
    return dict(zip(layout, table.T, strict=True))
