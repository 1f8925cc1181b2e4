"""Point clouds in ROS bags, which the radar's own firmware or driver found.

A bag without raw samples may hold the radar's clouds with their Doppler velocities, as
PointCloud2 of any fields. That is enough to follow the radar, but not to enhance it.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jradar.errors import UsageError
from jradar.recordings.bags.bags import (
    IMU,
    LidarStream,
    bag_topics,
    is_bag,
    open_imu,
)
from jradar.recordings.bags.messages import is_cloud_type
from jradar.recordings.bags.raw import READER as RAW
from jradar.recordings.recording import Imu, Poses

DOPPLERS = (  # fields of drivers, in small letters
    *("velocity", "doppler", "doppler_velocity", "doppler_mps", "v_doppler_mps"),
    *("radial_speed", "radial_velocity", "vel", "v"),
)


class RadarClouds(NamedTuple):
    """The clouds of one topic, and the IMU of the bag; receding points are positive.

    The places of both on the rig are not in a bag. The other fields of a `Recording`
    that a bag of clouds does not have are None.
    """

    path: Path
    topic: str
    field: str  # of the Doppler velocity
    stamps: Float[np.ndarray, " frame"]
    clouds: tuple[Float[np.ndarray, "point 4"], ...]  # x y z, Doppler velocity
    imu: Imu | None = None
    poses: Poses | None = None
    base_from_radar: Float[np.ndarray, "4 4"] | None = None
    base_from_imu: Float[np.ndarray, "4 4"] | None = None
    notes: tuple[str, ...] = ()

    @property
    def has_elevation(self) -> bool:
        """True if any point is above or below the radar."""
        return any(cloud[:, 2].any() for cloud in self.clouds)


def holds_radar_clouds(path: Path | str) -> bool:
    """True for a bag with clouds and without raw samples; its index is read."""
    path = Path(path)
    if not is_bag(path) or not path.exists() or RAW.matches(path):
        return False
    return any(is_cloud_type(kind) for kind, _ in bag_topics(path).values())


def open_radar_clouds(path: Path | str, *, topic: str | None = None) -> RadarClouds:
    """Read the clouds of the topic whose points have a Doppler velocity.

    `topic` is optional if there is only one such topic. Raises UsageError if there is
    none, or if there are several, and ValueError for a damaged bag.
    """
    path, found, seen = Path(path), [], []
    for name, (kind, count) in bag_topics(path).items():
        if not is_cloud_type(kind) or not count:
            continue
        stream = LidarStream(path, name, kind)
        columns = [*stream.read_points(0)]
        seen.append(f"{name} ({', '.join(columns)})")
        fields = [column for column in columns if column.lower() in DOPPLERS]
        if fields and topic in (None, name):
            found.append((name, fields[0], stream))
    if len(found) != 1:
        raise UsageError(
            f"{path}: {len(found)} topics of clouds with a Doppler velocity, expected "
            f"one with a field named {', '.join(DOPPLERS)}, or the name of one; the "
            f"bag has {'; '.join(seen) or 'no clouds'}"
        )
    name, field, stream = found[0]
    clouds = tuple(_table(stream.read_points(i), field) for i in range(len(stream)))
    imu, notes = None, stream.notes
    if any(kind == IMU and count for kind, count in bag_topics(path).values()):
        imu, more = open_imu(path)
        notes += more
    return RadarClouds(
        path, name, field, np.asarray(stream.stamps), clouds, imu, notes=notes
    )


def _table(columns: dict[str, np.ndarray], field: str) -> np.ndarray:
    """Return the points that have a velocity."""
    table = np.stack([columns[name] for name in (*"xyz", field)], -1).astype(np.float32)
    return table[np.isfinite(table).all(1)]
