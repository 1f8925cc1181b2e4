"""Radar sweeps of nuScenes: `.pcd`, a file or the folder of one sensor.

    x y z dyn_prop id rcs vx vy vx_comp vy_comp is_quality_valid ambig_state x_rms y_rms
    invalid_state pdh0 vx_rms vy_rms

Heights are 0; (vx, vy) is the radial velocity. Points that the devkit leaves out, of an
invalid or ambiguous state, are left out. Names end with the time in microseconds.
"""

import re
from pathlib import Path

import numpy as np

from jradar.files import open_file
from jradar.recordings.clouds.pcd import MAX_HEADER
from jradar.recordings.clouds.read import read_cloud
from jradar.recordings.points.frames import points_recording
from jradar.recordings.points.tables import number_order, stamps_of_names
from jradar.recordings.recording import Format, Recording, Stream

FIELDS = re.compile(rb"^FIELDS x y z dyn_prop id rcs vx vy ", re.MULTILINE)
VALID, UNAMBIGUOUS = 0, 3  # of invalid_state and ambig_state
LEFT_OUT = (
    "points of an invalid or ambiguous state are left out, as in nuScenes' devkit"
)


def open_nuscenes(path: Path | str) -> Recording:
    """Open a sweep, or the sweeps in a folder."""
    path = Path(path)
    files = _files(path)
    frames = Stream(lambda k: _read(files[k]), len(files), stamps_of_names(files))
    fields = {"x": "x", "y": "y", "z": "z", "velocity": "vx, vy", "power": "rcs"}
    name, notes = path.resolve().name if path.is_dir() else path.stem, (LEFT_OUT,)
    return points_recording(
        path, frames, name=name, fields=fields, forward="x", notes=notes
    )


def is_nuscenes(path: Path) -> bool:
    """True for a radar's .pcd of nuScenes, and for a folder that begins with one."""
    try:
        with open_file(_files(path)[0]) as file:
            return FIELDS.search(file.read(MAX_HEADER)) is not None
    except (OSError, ValueError, IndexError):
        return False


READER = Format("radar sweeps of nuScenes, .pcd", is_nuscenes, open_nuscenes)


def _files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path] if path.suffix == ".pcd" else []
    return sorted(path.glob("*.pcd"), key=number_order)


def _read(path: Path) -> dict[str, np.ndarray]:
    columns = read_cloud(path)
    kept = columns["invalid_state"] == VALID
    kept &= columns["ambig_state"] == UNAMBIGUOUS
    found = {name: columns[name][kept] for name in ("x", "y", "z", "rcs", "vx", "vy")}
    distance = np.maximum(np.hypot(found["x"], found["y"]), 1e-9)
    along = found.pop("vx") * found["x"] + found.pop("vy") * found["y"]
    return found | {"vx, vy": along / distance}
