"""Where the sensors of a bag are: the tree of frames on /tf_static and /tf.

    odom --moves--> base --fixed--> radar

A frame on /tf that never moves against its parent is fixed, too. Times are those of
recording.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jradar.lidar import Poses, rigid_transform
from jradar.recordings.bags.bags import NS, messages
from jradar.recordings.bags.messages import TF, decode_message

STILL = 1e-6  # metres, and parts of a quaternion, by which a fixed frame may move
UNIT = 0.01  # by which the length of a quaternion may differ from 1

Matrix = Float[np.ndarray, "4 4"]
Transform = Matrix | None


class Frames(NamedTuple):
    """The parent of each frame: the transform to it, or poses if the frame moves."""

    fixed: dict[str, tuple[str, Matrix]]
    moving: dict[str, tuple[str, Poses]]

    def root(self, frame: str) -> tuple[str, Matrix]:
        """Return the frame that holds a frame and all fixed to it, with its place."""
        to_root, seen = np.eye(4), set()
        while frame in self.fixed and frame not in seen:
            seen.add(frame)
            frame, step = self.fixed[frame]
            to_root = step @ to_root
        return frame, to_root

    def place(self, frame: str, base: str) -> Transform:
        """Return base_from_frame, None if the frames are not fixed to one another."""
        if frame == base:
            return np.eye(4) if frame and self.fixed else None
        (root, from_frame), (other, from_base) = self.root(frame), self.root(base)
        return np.linalg.solve(from_base, from_frame) if root == other else None


def read_frames(path: Path, topics: Iterable[str]) -> Frames:
    """Return the frames of these topics; ValueError for a damaged message."""
    found: dict[str, tuple[str, list[Any]]] = {}
    for topic in topics:
        for _, time, raw in messages(path, topic):
            message = decode_message(raw, TF, is_ros1=path.suffix == ".bag")
            for one in message.transforms:
                parent, child = plain(one.header.frame_id), plain(one.child_frame_id)
                if found.setdefault(child, (parent, []))[0] != parent:
                    found[child] = (parent, [])  # the newer parent counts
                found[child][1].append((time, *numbers(one.transform)))
    frames = Frames({}, {})
    for child, (parent, rows) in found.items():
        times, xyz, turns = (np.array(column) for column in zip(*rows, strict=True))
        check_poses(xyz, turns, f"{path}: a pose of {child} in {parent}")
        if max(np.ptp(xyz, 0).max(), np.ptp(turns, 0).max()) < STILL:
            frames.fixed[child] = parent, rigid_transform(xyz[0], turns[0])
        else:
            stamps, order = np.unique(times / NS, return_index=True)
            frames.moving[child] = parent, Poses(stamps, xyz[order], turns[order])
    return frames


def check_poses(
    xyz: Float[np.ndarray, "pose 3"], turns: Float[np.ndarray, "pose 4"], name: str
) -> None:
    """Raise ValueError for a pose that is not one; `name` begins the error."""
    lengths = np.linalg.norm(turns, axis=1)
    if not np.isfinite(xyz).all() or not (abs(lengths - 1) < UNIT).all():
        raise ValueError(f"{name} is NaN, or not a rotation")


def numbers(pose: Any) -> tuple[list[float], list[float]]:
    """Return position and quaternion, x y z w, of a ROS pose or transform."""
    known = hasattr(pose, "position")
    xyz = pose.position if known else pose.translation
    turn = pose.orientation if known else pose.rotation
    return [xyz.x, xyz.y, xyz.z], [turn.x, turn.y, turn.z, turn.w]


def plain(name: str) -> str:
    """Return the name of a frame of reference without its leading slash."""
    return name.lstrip("/")
