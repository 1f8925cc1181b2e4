"""The Astyx HiRes set, radar and LiDAR of each frame, packed into one NPZ.

    radar_cm i2 [point][3]   radar_mm_s i2   radar_half_db i2   radar_count [frame]
    lidar_cm i2 [point][3]                                      lidar_count [frame]
    lidar_time_us [frame]    frame [frame]

x forward, y left, z up, both sensors in the radar's frame. Velocities are positive when
a target approaches, and fold at 5.2 m/s. A time is that of the LiDAR's scan.
"""

from pathlib import Path

import numpy as np

from jradar.errors import parsing
from jradar.recordings.points.frames import points_recording
from jradar.recordings.points.packed import holds_arrays, read_arrays
from jradar.recordings.recording import Format, Recording, Stream

MAX_BYTES = 4 << 30
ARRAYS = {
    *("radar_cm", "radar_mm_s", "radar_half_db", "radar_count"),
    *("lidar_cm", "lidar_count", "lidar_time_us"),
}
FIELDS = {axis: axis for axis in "xyz"}
FIELDS |= {"velocity": "radar_mm_s", "power": "radar_half_db"}
FOLDED = "velocities fold at 5.2 m/s, which the radar does not resolve"


def open_astyx(path: Path | str) -> Recording:
    """Open the frames of a packed file; ValueError if its arrays do not fit."""
    path = Path(path)
    with parsing(path, "a packed .npz of Astyx"):
        arrays = read_arrays(path, ARRAYS, limit=MAX_BYTES)
        radar, lidar = (_rows(arrays, name) for name in ("radar", "lidar"))
        stamps = 1e-6 * arrays["lidar_time_us"]

    def points(index: int) -> dict[str, np.ndarray]:
        rows = radar[index]
        xyz = dict(zip("xyz", 0.01 * arrays["radar_cm"][rows].T, strict=True))
        velocity = 0.001 * arrays["radar_mm_s"][rows]
        power = 0.5 * arrays["radar_half_db"][rows]
        return xyz | {"radar_mm_s": velocity, "radar_half_db": power}

    def scan(index: int) -> np.ndarray:
        xyz = 0.01 * arrays["lidar_cm"][lidar[index]]
        return np.pad(xyz, ((0, 0), (0, 1))).astype(np.float32)

    return points_recording(
        path,
        Stream(points, len(radar), stamps),
        fields=FIELDS,
        forward="x",
        approaching=True,
        notes=(FOLDED,),
        lidar=Stream(scan, len(lidar), stamps),
        base_from_radar=np.eye(4),
        base_from_lidar=np.eye(4),
    )


READER = Format(
    "frames of Astyx HiRes, packed as .npz",
    lambda path: holds_arrays(path, ARRAYS),
    open_astyx,
)


def _rows(arrays, name) -> list[slice]:
    """Return the rows of each frame of a sensor; ValueError if they do not fit."""
    counts, points = arrays[f"{name}_count"], arrays[f"{name}_cm"]
    ends = np.cumsum(counts, dtype=np.int64)
    if len(counts) != len(arrays["lidar_time_us"]) or (counts < 0).any():
        raise ValueError(f"{name}_count has {len(counts)} frames")
    if not len(ends) or ends[-1] != len(points):
        raise ValueError(
            f"{name}_count adds up to {ends[-1:]}, of {len(points)} points"
        )
    return [slice(end - count, end) for end, count in zip(ends, counts, strict=True)]
