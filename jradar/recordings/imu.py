"""Inertial measurements: ColoRadar's text files, and sensor_msgs/Imu in ROS bags.

    imu/timestamps.txt  imu/imu_data.txt      ax ay az gx gy gz a line: m/s^2, rad/s
    a topic of sensor_msgs/Imu                in ROS 1, or ROS 2's CDR

An IMU that lies still with z upwards measures a specific force of +9.81 m/s^2 along z.
"""

import struct
from pathlib import Path

import numpy as np
from jaxtyping import Float

from jradar.errors import UsageError
from jradar.recordings.bags.bags import TopicStream, bag_topics
from jradar.recordings.coloradar.files import read_stamps, read_table
from jradar.recordings.recording import Imu

KIND = "sensor_msgs/msg/Imu"
NUMBERS = 37  # orientation, angular velocity, acceleration, each with its covariance
RATE, FORCE = slice(13, 16), slice(25, 28)  # among them
STANDARD_GRAVITY = 9.80665
MOST_IN_G = 3.0  # a smaller mean of |force| is in units of gravity: Livox's IMUs


def read_imu(folder: Path, notes: list[str]) -> Imu:
    """Return the IMU in a ColoRadar sequence's folder `imu`; repairs go to `notes`."""
    stamps = read_stamps(folder / "timestamps.txt", notes)
    rows = read_table(folder / "imu_data.txt", 6)
    count = min(len(stamps), len(rows))
    if len(stamps) != len(rows):
        notes.append(
            f"{folder.name}: {len(stamps)} stamps for {len(rows)} lines of "
            f"imu_data.txt: only the first {count} are used"
        )
    return _rising(stamps[:count], rows[:count, :3], rows[:count, 3:])


def open_imu(
    path: Path | str, *, topic: str | None = None
) -> tuple[Imu, tuple[str, ...]]:
    """Return the IMU in a bag, and notes on it.

    `topic` is optional if only one holds sensor_msgs/Imu. Raises UsageError for a topic
    that does not, and ValueError for a damaged bag.
    """
    topics = bag_topics(path)
    known = [name for name, (kind, _) in topics.items() if kind == KIND]
    if topic is None and len(known) == 1:
        topic = known[0]
    if topic not in known:
        asked = f"no {KIND} on {topic}" if topic else f"{len(known)} topics of {KIND}"
        raise UsageError(
            f"{path}: {asked}, expected one of {', '.join(known or topics)}"
        )
    stream = _ImuStream(Path(path), topic, KIND, sensor="IMU")
    table, notes = stream.table(), stream.notes
    if not len(table):
        raise ValueError(f"{path}: no messages on {topic}")
    force, rate = table[:, FORCE], table[:, RATE]
    if np.median(np.linalg.norm(force, axis=1)) < MOST_IN_G:
        force = force * STANDARD_GRAVITY
        notes += (f"{topic}: accelerations are in g, and are converted to m/s^2",)
    return _rising(stream.stamps, force, rate), notes


def _rising(stamps, force, rate):
    """The records at rising times; of several at one time the first is kept."""
    times, order = np.unique(stamps, return_index=True)
    return Imu(times, force[order], rate[order])


class _ImuStream(TopicStream):
    """All messages of a topic, read at once."""

    def table(self) -> Float[np.ndarray, "record number"]:
        """Return the numbers of each message after its header."""
        rows = [self._numbers(raw) for _, raw in self._messages()]
        table = np.array(rows).reshape(-1, NUMBERS)
        if not np.isfinite(table[:, [*range(13, 16), *range(25, 28)]]).all():
            raise ValueError(f"{self.path}: {self.topic} holds NaN or infinite numbers")
        return table

    def _numbers(self, raw):
        little = self.is_ros1 or raw[1:2] == b"\1"
        order, body = "<" if little else ">", raw if self.is_ros1 else raw[4:]
        at, align = (12, 1) if self.is_ros1 else (8, 8)
        try:
            (name,) = struct.unpack_from(f"{order}I", body, at)
            start = -(-(at + 4 + name) // align) * align
            return struct.unpack_from(f"{order}{NUMBERS}d", body, start)
        except struct.error as error:
            raise ValueError(
                f"{self.path}: a message of {self.topic} is cut off: {error}"
            ) from error
