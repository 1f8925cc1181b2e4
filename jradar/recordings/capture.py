"""A capture of one's own: a folder whose `capture.toml` says what lies in it.

    [radar]
    file = "adc_data.bin"            # of a DCA1000
    description = "profile.cfg"      # or mmWave Studio's log, or a .toml
    start_time_s = 1732190000.25     # of its first frame, on the LiDAR's clock; or
    # offset_s = 0.4                 # .. after the LiDAR's first cloud
    xyz = [0.03, 0.12, -0.09]        # where it is on the base: metres, x forward,
    rpy_degrees = [0, 0, 90]         # y left, z up; roll, then pitch, then yaw

    [lidar]
    file = "livox.bag"               # or a ROS 2 folder, .db3 or .mcap
    topic = "/livox/lidar"           # may be left out where it is the only one
    xyz = [0, 0, 0.2]
    rpy_degrees = [0, 30, 0]         # tilted forward: the x axis points down
    accumulate = 5                   # clouds around each that are laid over it

    [poses]
    file = "poses.txt"               # TUM: t x y z qx qy qz qw, of the base

`quaternion` (x y z w) may stand in the place of `rpy_degrees`; `[radar]` also takes
`device`, `iq_order`, `allow_partial` and `frame_period_s`. Times are in seconds.
"""

import difflib
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jradar.lidar import (
    Poses,
    accumulate as lay_over,
    interpolate_poses,
    rigid_transform,
)
from jradar.recordings.bags import open_bag
from jradar.recordings.dca1000 import open_dca1000
from jradar.recordings.recording import Recording, Stream
from jradar.recordings.text_files import toml

PLACE = {"xyz": list, "rpy_degrees": list, "quaternion": list}
KEYS = {
    "radar": {
        **{"file": str, "description": str, "device": str, "iq_order": str},
        **{"allow_partial": bool, "frame_period_s": float},
        **{"start_time_s": float, "offset_s": float, **PLACE},
    },
    "lidar": {"file": str, "topic": str, "accumulate": int, **PLACE},
    "poses": {"file": str},
}
KINDS = {str: "a text", float: "a number", int: "an integer", bool: "true or false"}
FARTHEST_M = 20.0  # from a sensor to the base of its rig
LATEST_S = 1e11  # since 1970, in seconds; in milliseconds it was 1973
MAX_POSES_BYTES = 512 << 20


def open_capture(folder: Path | str) -> Recording:
    """The recording that the `capture.toml` of `folder` describes.

    Raises ValueError for keys that are unknown, missing or of the wrong type, and for
    what does not fit together.
    """
    path = Path(folder)
    path = path if path.suffix == ".toml" else path / "capture.toml"
    if not path.is_file():
        raise FileNotFoundError(f"no such description of a capture: {path}")
    tables = _checked(path, toml(path))
    radar, lidar = tables["radar"], tables.get("lidar")
    options = ("device", "iq_order", "allow_partial")
    recording = open_dca1000(
        path.parent / radar["file"],
        path.parent / radar["description"],
        **{key: radar[key] for key in options if key in radar},
    )
    notes = [*recording.notes]
    recording = recording._replace(
        name=path.parent.resolve().name,
        path=path.parent,
        base_from_radar=_place(path, "radar", radar),
    )
    if "poses" in tables:
        poses = read_tum(path.parent / tables["poses"]["file"])
        recording = recording._replace(poses=poses)
    lidar_stamps = np.zeros(0)
    if lidar:
        clouds = open_bag(path.parent / lidar["file"], topic=lidar.get("topic"))
        notes += clouds.notes
        base_from_lidar = _place(path, "lidar", lidar)
        lidar_stamps = clouds.stamps
        near = lidar.get("accumulate", 1)
        if near > 1 and recording.poses is None:
            notes.append(f"{near} clouds are laid over one another as if nothing moved")
        stream = accumulate(clouds, near, recording.poses, base_from_lidar)
        recording = recording._replace(lidar=stream, base_from_lidar=base_from_lidar)
    stamps, doubt = _radar_stamps(path, radar, recording, lidar_stamps)
    cubes = Stream(recording.cubes.__getitem__, len(recording.cubes), stamps)
    return recording._replace(cubes=cubes, notes=(*notes, *doubt))


def read_tum(path: Path | str) -> Poses:
    """Poses of a text file with a line `t x y z qx qy qz qw` for each, `#` comments.

    Raises ValueError for other lines and for times that do not rise, naming the line.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"no such file of poses: {path}")
    if (size := path.stat().st_size) > MAX_POSES_BYTES:
        raise ValueError(f"{path} holds {size:,} bytes, at most {MAX_POSES_BYTES:,}")
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
                    "times that rise"
                )
            rows.append(row)
            before = row[0]
    if len(rows) < 2:
        raise ValueError(f"{path} holds {len(rows)} poses, expected 2 or more")
    table = np.array(rows)
    return Poses(table[:, 0], table[:, 1:4], table[:, 4:])


def accumulate(
    clouds: Stream,
    near: int,
    poses: Poses | None,
    base_from_lidar: Float[np.ndarray, "4 4"],
) -> Stream:
    """Each cloud with its neighbours, `near` in all, in its own LiDAR frame.

    With poses, neighbours are moved by the way between their stamps, and those left out
    whose pose is not known; without, they are laid over it as they are.
    """
    if near < 1:
        raise ValueError(f"{near} clouds to accumulate, expected 1 or more")
    if near == 1:
        return clouds
    lidar = None
    if poses is not None and clouds.stamps is not None:
        lidar = interpolate_poses(poses, clouds.stamps) @ base_from_lidar

    def read(index: int) -> Float[np.ndarray, "point 4"]:
        first = max(index - (near - 1) // 2, 0)
        around = range(first, min(index + near // 2 + 1, len(clouds)))
        moves = np.stack([np.eye(4)] * len(around))
        for place, other in enumerate(around):
            if lidar is not None and other != index:
                moves[place] = np.linalg.solve(lidar[index], lidar[other])
        return lay_over([clouds[other] for other in around], moves)

    return Stream(read, len(clouds), clouds.stamps)


def _checked(path, tables):
    """The tables of a file with known keys of the right types."""
    _known(path, "table", tables, KEYS)
    if "radar" not in tables:
        raise ValueError(f"{path}: no [radar] table")
    for name, table in tables.items():
        if not isinstance(table, dict):
            raise ValueError(f"{path}: {name} = {table!r}, expected a table [{name}]")
        _known(path, f"key of [{name}]", table, KEYS[name])
        needed = ("file", "description") if name == "radar" else ("file",)
        if missing := [key for key in needed if key not in table]:
            raise ValueError(f"{path}: [{name}] lacks {', '.join(missing)}")
        for key, value in table.items():
            kind = KEYS[name][key]
            numbers = isinstance(value, int | float) and not isinstance(value, bool)
            if kind is list:
                continue  # `_place` looks at it
            if not (numbers if kind is float else type(value) is kind):
                raise ValueError(
                    f"{path}: [{name}] {key} = {value!r}, expected {KINDS[kind]}"
                )
    return tables


def _known(path, what, given, names):
    for key in given:
        if key not in names:
            near = difflib.get_close_matches(key, names, 1) or [", ".join(names)]
            raise ValueError(f"{path}: unknown {what} {key!r}, expected {near[0]}")


def _place(path, name, table):
    """Transform from the sensor to the base."""

    def numbers(key: str, count: int) -> list[float] | None:
        values: Any = table.get(key)
        if values is None:
            return None
        plain = isinstance(values, list) and len(values) == count
        if not plain or not all(type(v) in (int, float) for v in values):
            raise ValueError(
                f"{path}: [{name}] {key} = {values!r}, expected {count} numbers"
            )
        return [float(value) for value in values]

    xyz = numbers("xyz", 3) or [0.0, 0.0, 0.0]
    angles, quaternion = numbers("rpy_degrees", 3), numbers("quaternion", 4)
    if angles and quaternion:
        raise ValueError(f"{path}: [{name}] has rpy_degrees and quaternion: keep one")
    if max(map(abs, xyz)) > FARTHEST_M:
        raise ValueError(
            f"{path}: [{name}] xyz = {xyz}, expected metres: are they millimetres?"
        )
    if angles:
        turn = Rotation.from_euler("xyz", angles, degrees=True).as_quat()
    else:
        turn = np.array(quaternion or [0.0, 0.0, 0.0, 1.0])
    if abs(np.linalg.norm(turn) - 1) > 0.01:
        raise ValueError(
            f"{path}: [{name}] quaternion = {quaternion}, expected x y z w of length 1"
        )
    return rigid_transform(np.array(xyz, float), turn)


def _radar_stamps(path, radar, recording, lidar_stamps):
    """Seconds of the radar's frames on the LiDAR's clock, and what is doubtful."""
    period = radar.get("frame_period_s", recording.radar.frame_period_s)
    given = [key for key in ("start_time_s", "offset_s") if key in radar]
    if not period > 0:
        raise ValueError(
            f"{path}: the time between frames is not known, expected [radar] "
            "frame_period_s"
        )
    if len(given) == 2:
        raise ValueError(f"{path}: [radar] has start_time_s and offset_s: keep one")
    if radar.get("start_time_s", 0) > LATEST_S:
        raise ValueError(
            f"{path}: [radar] start_time_s = {radar['start_time_s']}, expected "
            "seconds: are they milliseconds or nanoseconds?"
        )
    if "offset_s" in given and not len(lidar_stamps):
        raise ValueError(f"{path}: [radar] offset_s counts from the first cloud: none")
    first = lidar_stamps[0] if len(lidar_stamps) else 0.0
    start = radar.get("start_time_s", first + radar.get("offset_s", 0.0))
    stamps, doubt = start + np.arange(len(recording.cubes)) * period, []
    if len(lidar_stamps) and not given:
        doubt.append("no start_time_s: the radar is taken to start with the LiDAR")
    if len(lidar_stamps) and (stamps[-1] < first or stamps[0] > lidar_stamps[-1]):
        doubt.append(
            f"the radar's frames, {stamps[0]:.3f} to {stamps[-1]:.3f} s, and the "
            f"clouds, {first:.3f} to {lidar_stamps[-1]:.3f} s, have no time in common"
        )
    return stamps, doubt
