"""Inertial measurements: sensor_msgs/Imu in ROS 1 and ROS 2 bags.

An IMU that lies still with z upwards measures a specific force of +9.81 m/s^2 along z.
"""

import functools
import struct
from pathlib import Path

import numpy as np

from jradar.recordings.bags.bags import TopicStream, messages, topic_of
from jradar.recordings.bags.messages import decode_imu
from jradar.recordings.recording import Imu

KIND = "sensor_msgs/msg/Imu"
RATE, FORCE = slice(13, 16), slice(25, 28)  # of the numbers of a message
STANDARD_GRAVITY = 9.80665
MOST_IN_G = 3.0  # a smaller mean of |force| is in units of gravity: Livox's IMUs


def open_imu(
    path: Path | str, *, topic: str | None = None
) -> tuple[Imu, tuple[str, ...]]:
    """Return the IMU in a bag, and notes on it.

    `topic` is optional if only one holds sensor_msgs/Imu; of several records at one
    time the first is kept. Errors as in `open_bag`.
    """
    topic, _ = topic_of(path, topic, KIND.__eq__, KIND)
    path = Path(path)
    decode = functools.partial(decode_imu, is_ros1=path.suffix == ".bag")
    stream = TopicStream(path, topic, decode, sensor="IMU")
    notes = stream.notes
    try:
        table = np.array([decode(raw) for *_, raw in messages(path, topic)])
    except struct.error as error:
        raise ValueError(f"{path}: a message of {topic} is cut off: {error}") from error
    if not len(table):
        raise ValueError(f"{path}: no messages on {topic}")
    if not np.isfinite(table[:, [*range(37)[RATE], *range(37)[FORCE]]]).all():
        raise ValueError(f"{path}: {topic} holds NaN or infinite numbers")
    force, rate = table[:, FORCE], table[:, RATE]
    if np.median(np.linalg.norm(force, axis=1)) < MOST_IN_G:
        force = force * STANDARD_GRAVITY
        notes += (f"{topic}: accelerations are in g, and are converted to m/s^2",)
    times, order = np.unique(np.asarray(stream.stamps), return_index=True)
    return Imu(times, force[order], rate[order]), notes
