"""A capture of your own rig: radar, LiDAR, poses, IMU and a `capture.toml`.

    [radar]
    file = "adc_data.bin"            # of a DCA1000, a bag of raw samples, or points
    # topic = "/radar/points"        # .. of a bag, if several hold a radar's points
    description = "profile.cfg"      # or mmWave Studio's log, or a .toml; a walk.mcap
                                     # of `jradar record` needs none
    start_time_s = 1732190000.25     # of its first frame, on the LiDAR's clock; or
    # offset_s = 0.4                 # .. after the LiDAR's first cloud; or
    # stamps = "frames.txt"          # .. lines of a frame's time and its lost bytes
    # add_s = 0.03                   # to the times in a bag or in stamps
    xyz = [0.03, 0.12, -0.09]        # position on the base: metres, x forward,
    rpy_degrees = [0, 0, 90]         # y left, z up; roll, then pitch, then yaw

    [lidar]
    file = "livox.bag"               # or a ROS 2 folder, .db3 or .mcap
    topic = "/livox/lidar"           # optional if only one topic holds clouds
    xyz = [0, 0, 0.2]
    rpy_degrees = [0, 30, 0]         # tilted forward: the x axis points down
    accumulate = 5                   # neighbouring clouds merged into each

    [poses]
    file = "poses.txt"               # of the base: TUM, t x y z qx qy qz qw

    [imu]
    file = "livox.bag"               # with sensor_msgs/Imu
    topic = "/livox/imu"             # optional if only one topic holds them
    rpy_degrees = [0, 30, 0]

A [mount] in the radar's description, as `jradar calibrate --mount` writes it, replaces
the radar's place here. `quaternion` (x y z w) may replace `rpy_degrees`. `[radar]` also
takes `device`, `iq_order`, `allow_partial` and `frame_period_s`. Times are in seconds.
All files lie in the folder or below it.
"""

from pathlib import Path
from typing import Any

import numpy as np
import scipy  # loads `spatial` when it is first used
from jaxtyping import Float

from jradar.errors import UsageError
from jradar.files import inside
from jradar.lidar import Poses, interpolate_poses, rigid_transform
from jradar.lidar.align import accumulate as merge
from jradar.recordings.bags.bags import is_bag, open_bag, open_imu
from jradar.recordings.bags.raw import open_raw_bag
from jradar.recordings.descriptions import CAPTURE_TOML as NAME
from jradar.recordings.points.formats import READERS as POINTS
from jradar.recordings.recording import (
    Format,
    Recording,
    Stream,
    clocks_apart,
    loss_notes,
    read,
)
from jradar.recordings.text_files import check_names, read_frame_times, read_tum, toml
from jradar.recordings.ti.dca1000 import open_dca1000

PLACE = {"xyz": 3, "rpy_degrees": 3, "quaternion": 4}  # lists of so many numbers
KEYS = {
    "radar": {
        **{"file": str, "description": str, "device": str, "iq_order": str},
        "topic": str,
        **{"allow_partial": bool, "frame_period_s": float, "stamps": str},
        **{"start_time_s": float, "offset_s": float, "add_s": float, **PLACE},
    },
    "lidar": {"file": str, "topic": str, "accumulate": int, **PLACE},
    "poses": {"file": str},
    "imu": {"file": str, "topic": str, **PLACE},
}
TIMES = ("start_time_s", "offset_s", "frame_period_s")
NEEDED = {name: ("file",) for name in KEYS}
KINDS = {str: "a text", float: "a number", int: "an integer", bool: "true or false"}
START = (
    "set start_time_s to the time of the first frame on the LiDAR's clock, or offset_s "
    "to its time after the first cloud"
)
ADD = "set add_s to the seconds that bring the frames' times to the LiDAR's clock"
FARTHEST_M = 20.0  # from a sensor to the base of its rig
LATEST_S = 1e11  # seconds since 1970; a larger stamp is in another unit
LARGEST = 1e100  # of any number, so that its square is finite


def open_capture(folder: Path | str) -> Recording:
    """Open the recording that the `capture.toml` in `folder` describes.

    Raises UsageError for a wrong `capture.toml`, and ValueError for damaged files.
    """
    path = Path(folder)
    path = path if path.name == NAME else path / NAME
    if not path.is_file():
        raise FileNotFoundError(f"no such description of a capture: {path}")
    tables = _read_capture_toml(path)
    radar, lidar = tables["radar"], tables.get("lidar")
    recording = _frames(path, radar)
    notes = [*recording.notes]
    base_from_radar = recording.base_from_radar
    if base_from_radar is None:
        base_from_radar = _read_place(path, "radar", radar)
    else:
        source = radar.get("description", radar["file"])
        notes.append(f"the radar's place is that in {source}, [mount]")
    poses = scans = base_from_lidar = None
    lidar_stamps = np.zeros(0)
    if "poses" in tables:
        poses = read_tum(_file(path, "poses", tables["poses"]))
    if lidar:
        clouds = open_bag(_file(path, "lidar", lidar), topic=lidar.get("topic"))
        notes += clouds.notes
        base_from_lidar = _read_place(path, "lidar", lidar)
        lidar_stamps = clouds.stamps
        near = lidar.get("accumulate", 1)
        if near > 1 and poses is None:
            notes.append(f"no poses: {near} clouds are merged as if nothing moved")
        scans = accumulate(clouds, near, poses, base_from_lidar)
    imu = base_from_imu = None
    if table := tables.get("imu"):
        imu, said = open_imu(_file(path, "imu", table), topic=table.get("topic"))
        notes += said
        base_from_imu = _read_place(path, "imu", table)
    stamps, warnings = _radar_stamps(path, radar, recording, lidar_stamps)
    return _at(recording, stamps)._replace(
        name=path.parent.resolve().name,
        path=path.parent,
        lidar=scans,
        poses=poses,
        imu=imu,
        base_from_imu=base_from_imu,
        base_from_radar=base_from_radar,
        base_from_lidar=base_from_lidar,
        notes=(*notes, *warnings),
    )


READER = Format(
    f"a folder with a {NAME}",
    lambda path: path.name == NAME or (path / NAME).is_file(),
    open_capture,
)


def accumulate(
    clouds: Stream,
    near: int,
    poses: Poses | None,
    base_from_lidar: Float[np.ndarray, "4 4"],
) -> Stream:
    """Return each cloud merged with its neighbours, `near` in all, in its own frame.

    With poses, neighbours are moved by the motion between the stamps, and neighbours
    without a pose are left out. Without poses they are merged unmoved.
    """
    if near < 1:
        raise UsageError(f"accumulate = {near} clouds, expected 1 or more")
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
        return merge([clouds[other] for other in around], moves)

    return Stream(read, len(clouds), clouds.stamps)


def _file(path: Path, name: str, table: dict[str, Any], *, key: str = "file") -> Path:
    """Return the file that a table names; UsageError if it leaves the folder."""
    try:
        return inside(path.parent, table[key], source=path)
    except ValueError as error:
        raise UsageError(f"{error}: copy or link the {key} of [{name}]") from error


def _frames(path, radar) -> Recording:
    """Return the frames or points of the file that [radar] names, as it is."""
    file, description = _file(path, "radar", radar), None
    if "description" in radar:
        description = _file(path, "radar", radar, key="description")
    found = next((kind for kind in POINTS if kind.matches(file)), None)
    names = ("iq_order", "device", *(["topic"] if found else []))
    options = {key: radar[key] for key in names if key in radar}
    if found is not None or is_bag(file):
        own = (*(TIMES if is_bag(file) else ()), "stamps", "allow_partial")
        if given := [key for key in own if key in radar]:
            raise UsageError(
                f"{path}: [radar] has {given[0]}, but the frames of {file.name} have "
                "times of their own: leave it out, or correct them with add_s"
            )
        if found is None:
            return open_raw_bag(file, description, **options)
        return read(file, POINTS, description=description, **options)
    if description is None:
        raise UsageError(f"{path}: [radar] lacks description")
    partial = radar.get("allow_partial", False)
    recording = open_dca1000(file, description, allow_partial=partial, **options)
    return _stamped(path, radar, recording) if "stamps" in radar else recording


def _at(recording: Recording, stamps: np.ndarray) -> Recording:
    """Return the recording with other times of its frames."""
    frames = recording.frames
    moved = Stream(frames.__getitem__, len(frames), stamps)
    return recording._replace(
        **{"points" if frames is recording.points else "cubes": moved}
    )


def _stamped(path, radar, recording):
    """Return the frames whose times were recorded, and how many bytes each lost."""
    if given := [key for key in TIMES if key in radar]:
        raise UsageError(f"{path}: [radar] has stamps and {given[0]}: keep one of them")
    times, lost = read_frame_times(_file(path, "radar", radar, key="stamps"))
    count = min(len(times), len(recording.cubes))
    if not count:
        raise ValueError(f"{path}: no frame of {radar['stamps']} is in {radar['file']}")
    return recording._replace(
        cubes=Stream(recording.cubes.__getitem__, count, times[:count]),
        lost_bytes=lost[:count],
        notes=(*recording.notes, *loss_notes(lost[:count])),
    )


def _radar_stamps(path, radar, recording, lidar_stamps):
    """Return the times of the radar's frames on the LiDAR's clock, and warnings."""
    known, frames = recording.radar, recording.frames
    period = 0.0 if known is None else known.spec.frame_period_s
    period = radar.get("frame_period_s", period)
    given = [key for key in TIMES[:2] if key in radar]
    has = "stamps" in radar or is_bag(recording.path) or frames is recording.points
    own = frames.stamps if has else None
    timed = own is not None and not given
    if "add_s" in radar and not timed:
        raise UsageError(
            f"{path}: [radar] add_s changes the times of stamps or of a bag: change "
            "start_time_s or offset_s instead"
        )
    if not period > 0 and own is None:
        raise UsageError(
            f"{path}: the time between frames is unknown: set frame_period_s in [radar]"
        )
    if len(given) == 2:
        raise UsageError(
            f"{path}: [radar] has start_time_s and offset_s: keep one of them"
        )
    if wrong := [key for key in (*TIMES, "add_s") if abs(radar.get(key, 0)) > LATEST_S]:
        raise UsageError(
            f"{path}: [radar] {wrong[0]} = {radar[wrong[0]]:g}, expected seconds: are "
            "they milliseconds or nanoseconds?"
        )
    if "offset_s" in given and not len(lidar_stamps):
        raise UsageError(
            f"{path}: [radar] offset_s counts from the first LiDAR cloud, but there "
            "are no clouds: set start_time_s instead"
        )
    first = float(lidar_stamps[0]) if len(lidar_stamps) else 0.0
    start = radar.get("start_time_s", first + radar.get("offset_s", 0.0))
    steps = np.arange(len(frames)) * period if own is None else own - own[0]
    stamps, warnings = start + steps, []
    if timed:
        stamps = own + radar.get("add_s", 0.0)
    elif len(lidar_stamps) and not given:
        warnings.append("no start_time_s: the radar is assumed to start with the LiDAR")
    if spans := clocks_apart(stamps, lidar_stamps):
        warnings.append(
            f"the clocks of radar and LiDAR do not match: {spans}: "
            + (ADD if timed else START)
        )
    return stamps, warnings


def _read_capture_toml(path: Path) -> dict[str, dict[str, Any]]:
    """Return the tables; UsageError for wrong or missing keys and wrong types."""
    tables = toml(path)
    check_names(path, "table", tables, KEYS)
    if "radar" not in tables:
        raise UsageError(f"{path}: no [radar] table")
    for name, table in tables.items():
        if not isinstance(table, dict):
            raise UsageError(f"{path}: {name} = {table!r}, expected a table [{name}]")
        check_names(path, f"key of [{name}]", table, KEYS[name])
        if missing := [key for key in NEEDED[name] if key not in table]:
            raise UsageError(f"{path}: [{name}] lacks {', '.join(missing)}")
        for key, value in table.items():
            if not _fits(value, kind := KEYS[name][key]):
                expected = KINDS.get(kind, f"{kind} numbers")
                raise UsageError(
                    f"{path}: [{name}] {key} = {value!r:.80}, expected {expected}"
                )
    return tables


def _fits(value: Any, kind: Any) -> bool:
    """True for a value of a type, or for a list of `kind` numbers."""
    if isinstance(kind, int):
        numbers = isinstance(value, list) and len(value) == kind
        return numbers and all(_fits(number, float) for number in value)
    if kind is float:
        return type(value) in (int, float) and abs(value) <= LARGEST  # False for NaN
    return type(value) is kind


def _read_place(path, name, table) -> Float[np.ndarray, "4 4"]:
    """Return the transform from the sensor in table `name` to the base."""
    xyz = table.get("xyz", [0.0, 0.0, 0.0])
    angles, quaternion = table.get("rpy_degrees"), table.get("quaternion")
    if angles and quaternion:
        raise UsageError(
            f"{path}: [{name}] has rpy_degrees and quaternion: keep one of them"
        )
    if max(map(abs, xyz)) > FARTHEST_M:
        raise UsageError(
            f"{path}: [{name}] xyz = {xyz}, expected at most {FARTHEST_M:g} m: are "
            "the numbers millimetres?"
        )
    turn = np.array(quaternion or [0, 0, 0, 1], float)
    if angles:
        rotation = scipy.spatial.transform.Rotation
        turn = rotation.from_euler("xyz", angles, degrees=True).as_quat()
    if abs(np.linalg.norm(turn) - 1) > 0.01:
        raise UsageError(
            f"{path}: [{name}] quaternion = {quaternion}, expected x y z w of length 1"
        )
    return rigid_transform(np.array(xyz, float), turn)
