"""The `capture.toml` of a rig, checked: keys, types, and places on the base.

    [radar]
    file = "adc_data.bin"            # of a DCA1000
    description = "profile.cfg"      # or mmWave Studio's log, or a .toml
    start_time_s = 1732190000.25     # of its first frame, on the LiDAR's clock; or
    # offset_s = 0.4                 # .. after the LiDAR's first cloud
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

`quaternion` (x y z w) may replace `rpy_degrees`. `[radar]` also takes `device`,
`iq_order`, `allow_partial` and `frame_period_s`. Times are in seconds.
"""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jradar.errors import UsageError
from jradar.lidar import rigid_transform
from jradar.recordings.text_files import check_names, toml

NAME = "capture.toml"
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
NEEDED = {"radar": ("file", "description"), "lidar": ("file",), "poses": ("file",)}
KINDS = {str: "a text", float: "a number", int: "an integer", bool: "true or false"}
FARTHEST_M = 20.0  # from a sensor to the base of its rig

Table = dict[str, Any]


def read_capture_toml(path: Path) -> dict[str, Table]:
    """Return the tables of a `capture.toml`.

    Raises UsageError for keys that are unknown, missing or of the wrong type.
    """
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
            kind = KEYS[name][key]
            types = (int, float) if kind is float else (kind,)
            if kind is not list and type(value) not in types:  # lists: `read_place`
                raise UsageError(
                    f"{path}: [{name}] {key} = {value!r}, expected {KINDS[kind]}"
                )
    return tables


def read_place(path: Path, name: str, table: Table) -> Float[np.ndarray, "4 4"]:
    """Return the transform from the sensor in table `name` to the base."""

    def numbers(key: str, count: int) -> list[float] | None:
        values: Any = table.get(key)
        if values is None:
            return None
        plain = isinstance(values, list) and len(values) == count
        if not plain or not all(type(v) in (int, float) for v in values):
            raise UsageError(
                f"{path}: [{name}] {key} = {values!r}, expected {count} numbers"
            )
        return [float(value) for value in values]

    xyz = numbers("xyz", 3) or [0.0, 0.0, 0.0]
    angles, quaternion = numbers("rpy_degrees", 3), numbers("quaternion", 4)
    if angles and quaternion:
        raise UsageError(
            f"{path}: [{name}] has rpy_degrees and quaternion: keep one of them"
        )
    if max(map(abs, xyz)) > FARTHEST_M:
        raise UsageError(
            f"{path}: [{name}] xyz = {xyz}, expected at most {FARTHEST_M:g} m: are "
            "the numbers millimetres?"
        )
    if angles:
        turn = Rotation.from_euler("xyz", angles, degrees=True).as_quat()
    else:
        turn = np.array(quaternion or [0.0, 0.0, 0.0, 1.0])
    if abs(np.linalg.norm(turn) - 1) > 0.01:
        raise UsageError(
            f"{path}: [{name}] quaternion = {quaternion}, expected x y z w of length 1"
        )
    return rigid_transform(np.array(xyz, float), turn)
