"""What else a bag of a robot holds: LiDAR, IMU, odometry, and where the sensors are.

    only other cloud topic        a LiDAR's scans
    only sensor_msgs/Imu          an IMU
    only nav_msgs/Odometry        poses of its child frame, the base
    /tf_static, /tf               places of the sensors, by the frames in their headers;
                                  without odometry, poses of the base, too

All times are brought to the recorder's clock. Of two topics of one kind, none is used,
with a note: a capture.toml names one. Without odometry, the base is the frame to which
the radar is fixed, and which moves or has no parent.
"""

import struct
from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jradar.lidar import Poses
from jradar.recordings.bags.bags import (
    IMU,
    LidarStream,
    TopicStream,
    bag_topics,
    messages,
    open_imu,
)
from jradar.recordings.bags.messages import (
    TF,
    decode_message,
    frame_of,
    is_cloud_type,
)
from jradar.recordings.bags.transforms import (
    Frames,
    Transform,
    check_poses,
    numbers,
    plain,
    read_frames,
)
from jradar.recordings.recording import Imu

ODOMETRY = "nav_msgs/msg/Odometry"
STATIC = "tf_static"  # at the end of the topic's name


class Rig(NamedTuple):
    """The fields of a `Recording` next to those of its radar."""

    lidar: LidarStream | None = None
    poses: Poses | None = None
    imu: Imu | None = None
    base_from_radar: Transform = None
    base_from_lidar: Transform = None
    base_from_imu: Transform = None


def read_rig(
    path: Path, radar: str, *, radars: Collection[str]
) -> tuple[Rig, tuple[str, ...]]:
    """Return the rest of a bag, whose radar is on the topic `radar`, and notes.

    `radars` are all topics of clouds that are not a LiDAR's. A damaged topic is left
    out.
    """
    notes, kinds = list[str](), bag_topics(path)

    def only(is_wanted: Callable[[str], bool], what: str, read: Callable) -> Any:
        names = [
            name
            for name, (kind, count) in kinds.items()
            if count and name not in radars and is_wanted(kind)
        ]
        if len(names) > 1:
            notes.append(f"{len(names)} topics hold {what}, and none is used")
        if len(names) != 1:
            return "", None
        try:
            found, said = read(path, names[0])
        except (ValueError, struct.error) as error:
            notes.append(f"{what} are left out: {error}")
            return "", None
        notes.extend(said)
        return names[0], found

    scans, lidar = only(is_cloud_type, "a LiDAR's clouds", partial(_lidar, kinds=kinds))
    inertial, imu = only(IMU.__eq__, "measurements of an IMU", _imu)
    _, odometry = only(ODOMETRY.__eq__, "odometry", _odometry)
    poses, base = odometry or (None, "")
    frames, transforms = Frames({}, {}), [n for n, (k, _) in kinds.items() if k == TF]
    static = [name for name in transforms if name.endswith(STATIC)]
    try:  # /tf may hold millions of poses
        frames = read_frames(path, static if static and poses else transforms)
    except (ValueError, struct.error) as error:
        notes.append(f"the sensors' places are left out: {error}")
    topics = {"radar": radar, "lidar": scans, "imu": inertial}
    names = {name: _frame(path, topic) for name, topic in topics.items() if topic}
    base = base or frames.root(names["radar"])[0]
    if poses is None and base in frames.moving:
        world, poses = frames.moving[base]
        notes.append(f"poses are those of {base} in {world}, on the topic /tf")
    places = {
        f"base_from_{name}": frames.place(frame, base) for name, frame in names.items()
    }
    return Rig(lidar, poses, imu, **places), tuple(notes)


def _lidar(path, topic, *, kinds):
    stream = LidarStream(path, topic, kinds[topic][0], on_recorders_clock=True)
    return stream, (f"scans are on the topic {topic}", *stream.notes)


def _imu(path, topic):
    return open_imu(path, topic=topic, on_recorders_clock=True)


def _odometry(path: Path, topic: str) -> tuple[tuple[Poses, str], tuple[str, ...]]:
    """Return the poses of the base, its frame, and notes."""

    def decode(raw):
        message = decode_message(raw, ODOMETRY, is_ros1=path.suffix == ".bag")
        return message.child_frame_id, *numbers(message.pose.pose)

    stream = TopicStream(
        path, topic, decode, sensor="odometry", on_recorders_clock=True, extract=decode
    )
    names, xyz, turns = zip(*stream.extracted, strict=True)
    xyz, turns = np.array(xyz), np.array(turns)
    check_poses(xyz, turns, f"{path}: a pose of {topic}")
    stamps, order = np.unique(stream.stamps, return_index=True)
    poses = Poses(stamps, xyz[order], turns[order])
    return (poses, plain(names[0])), (f"poses are on the topic {topic}", *stream.notes)


def _frame(path: Path, topic: str) -> str:
    raw = next((raw for *_, raw in messages(path, topic)), b"")
    return plain(frame_of(raw, is_ros1=path.suffix == ".bag"))
