"""What else a bag of a robot holds: LiDAR, IMU, odometry, and where the sensors are.

    only other cloud topic        a LiDAR's scans
    only sensor_msgs/Imu          an IMU
    only nav_msgs/Odometry        poses of its child frame, the base
    /tf_static                    places of the sensors, by the frames in their headers

All times are brought to the recorder's clock. Of two topics of one kind, none is used,
with a note: a capture.toml names one. Without odometry, the base is the root of the
tree of frames that holds the radar.
"""

import struct
from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jradar.lidar import Poses, rigid_transform
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
from jradar.recordings.recording import Imu

ODOMETRY = "nav_msgs/msg/Odometry"
STATIC = "tf_static"  # at the end of the topic's name

Transform = Float[np.ndarray, "4 4"] | None


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

    `radars` are the topics of all radars. A damaged topic is left out.
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
    tree, transforms = {}, [n for n, (kind, _) in kinds.items() if kind == TF]
    try:
        tree = _tree(path, [name for name in transforms if name.endswith(STATIC)])
    except ValueError as error:
        notes.append(f"the sensors' places are left out: {error}")
    topics = {"radar": radar, "lidar": scans, "imu": inertial}
    frames = {name: _frame(path, topic) for name, topic in topics.items() if topic}
    base = base or _root(frames["radar"], tree)[0]
    places = {
        f"base_from_{name}": _place(frame, base, tree) for name, frame in frames.items()
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
        return message.child_frame_id, *_numbers(message.pose.pose, "position")

    stream = TopicStream(
        path, topic, decode, sensor="odometry", on_recorders_clock=True, extract=decode
    )
    names, xyz, turns = zip(*stream.extracted, strict=True)
    xyz, turns = np.array(xyz), np.array(turns)
    lengths = np.linalg.norm(turns, axis=1)
    if not np.isfinite(xyz).all() or not (abs(lengths - 1) < 0.01).all():
        raise ValueError(f"{path}: a pose of {topic} is NaN, or not a rotation")
    stamps, order = np.unique(stream.stamps, return_index=True)
    poses = Poses(stamps, xyz[order], turns[order])
    return (poses, _plain(names[0])), (f"poses are on the topic {topic}", *stream.notes)


def _tree(path: Path, topics: list[str]) -> dict[str, tuple[str, np.ndarray]]:
    """Return the parent of each frame, and the transform to it."""
    tree = {}
    for topic in topics:
        for *_, raw in messages(path, topic):
            message = decode_message(raw, TF, is_ros1=path.suffix == ".bag")
            for one in message.transforms:
                place = rigid_transform(
                    *map(np.array, _numbers(one.transform, "translation"))
                )
                tree[_plain(one.child_frame_id)] = _plain(one.header.frame_id), place
    return tree


def _numbers(pose: Any, position: str) -> tuple[list[float], list[float]]:
    """Return position and quaternion, x y z w, of a pose or a transform."""
    xyz = getattr(pose, position)
    turn = pose.orientation if position == "position" else pose.rotation
    return [xyz.x, xyz.y, xyz.z], [turn.x, turn.y, turn.z, turn.w]


def _frame(path: Path, topic: str) -> str:
    raw = next((raw for *_, raw in messages(path, topic)), b"")
    return _plain(frame_of(raw, is_ros1=path.suffix == ".bag"))


def _plain(name: str) -> str:
    return name.lstrip("/")


def _root(
    frame: str, tree: dict[str, tuple[str, np.ndarray]]
) -> tuple[str, np.ndarray]:
    """Return the root above a frame, and the transform to it."""
    to_root, seen = np.eye(4), set()
    while frame in tree and frame not in seen:
        seen.add(frame)
        frame, step = tree[frame]
        to_root = step @ to_root
    return frame, to_root


def _place(frame: str, base: str, tree: dict[str, tuple[str, np.ndarray]]) -> Transform:
    """Return base_from_frame, None if the tree does not join them."""
    if frame == base:
        return np.eye(4) if frame and tree else None
    (root, from_frame), (other, from_base) = _root(frame, tree), _root(base, tree)
    return np.linalg.solve(from_base, from_frame) if root == other else None
