"""LiDAR clouds in ROS bags, through the package `rosbags`; no ROS is needed.

    recording.bag                     ROS 1
    folder with metadata.yaml         ROS 2, SQLite or MCAP; or a single .db3 or .mcap

`cloud_messages` lists the types of messages that hold clouds.
"""

import functools
import itertools
import os
import struct
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from jradar.errors import UsageError
from jradar.files import open_file
from jradar.recordings.bags.cloud_messages import decode_cloud, is_cloud_type
from jradar.recordings.bags.unpacking import limit_rosbags
from jradar.recordings.recording import Stream

INTENSITIES = ("intensity", "reflectivity", "i")
NS = 1_000_000_000
OTHER_CLOCK_S = 10.0  # a larger offset between two clocks is reported
READING = threading.Lock()  # all streams of a bag share its file position


class TopicStream(Stream):
    """The messages of one topic, decoded when they are accessed."""

    def __init__(
        self, path: Path, topic: str, kind: str, *, sensor: str, has_header: bool = True
    ):
        """Read the times of all messages of `topic`.

        `sensor` names the sensor in notes. Without a header the times of recording
        count.
        """
        self.path, self.topic, self.kind = path, topic, kind
        self.is_ros1, self._sensor = path.suffix == ".bag", sensor
        with READING:
            found = [(time, self._stamp(raw)) for time, raw in self._messages()]
        self._times, headers = np.array(found, np.int64).reshape(-1, 2).T
        seconds, notes = self._times / NS, ()
        if has_header:
            seconds, notes = self._stamps(headers)
        super().__init__(self.decode, len(found), seconds, notes)

    def decode(self, index: int) -> Any:
        """Return item `index`."""
        raise TypeError(f"{type(self).__name__} decodes no messages: write its decode")

    def message(self, index: int) -> bytes:
        """Return the bytes of message `index`; several may have the same time."""
        time = int(self._times[index])
        before = int(np.searchsorted(self._times, time))
        with READING:
            messages = self._messages(time, time + 1)
            for _, raw in itertools.islice(messages, index - before, None):
                return raw
        raise ValueError(f"{self.path} changed while it was read: open it again")

    def _messages(
        self, start: int | None = None, stop: int | None = None
    ) -> Iterator[tuple[int, bytes]]:
        """Yield the time in nanoseconds and the bytes of the topic's messages."""
        reader = _reader(self.path)
        connections = [c for c in reader.connections if c.topic == self.topic]
        try:
            for _, time, raw in reader.messages(connections, start, stop):
                yield time, bytes(raw)
        except Exception as error:
            raise ValueError(_damaged(self.path, error)) from error

    def _stamp(self, raw):
        """Return the nanoseconds in a cloud's header; 0 if the header is cut off."""
        form = "<4xII" if self.is_ros1 else "<4xiI" if raw[1:2] == b"\1" else ">4xiI"
        if len(raw) < struct.calcsize(form):
            return 0
        seconds, nanoseconds = struct.unpack_from(form, raw)
        return seconds * NS + nanoseconds

    def _stamps(self, headers):
        """Return the headers' times in seconds, or the bag's times with a note."""
        zero = (headers == 0).any()
        if zero or (np.diff(headers) <= 0).any():
            fault = "zero" if zero else "not rising"
            return self._times / NS, (
                f"{self.topic}: the stamps in the headers are {fault}; the times of "
                "recording are used instead",
            )
        late = np.median(self._times - headers) / NS if len(headers) else 0.0
        if abs(late) > OTHER_CLOCK_S:
            return headers / NS, (
                f"{self.topic}: the {self._sensor}'s clock is {late:,.3f} s behind the "
                f"recorder's; the {self._sensor}'s stamps are used",
            )
        return headers / NS, ()


class LidarStream(TopicStream):
    """Clouds of one topic: float32 [point, 4], x y z intensity, in the LiDAR's frame.

    Missing returns, points at (0, 0, 0) or not finite, are removed.
    """

    def __init__(self, path: Path, topic: str, kind: str):
        """Read the stamps of all clouds of `topic`."""
        super().__init__(path, topic, kind, sensor="LiDAR")

    def read_points(self, index: int) -> dict[str, np.ndarray]:
        """Return all fields of the points of cloud `index` by name.

        Livox's `offset_time` is in nanoseconds after the cloud's stamp.
        """
        raw = self.message(index)
        try:
            points = decode_cloud(raw, self.kind, is_ros1=self.is_ros1)
        except (ValueError, struct.error) as error:
            raise ValueError(
                f"{self.path}: message {index} of {self.topic}: {error}"
            ) from error
        columns = {name: points[name] for name in points.dtype.names or ()}
        if not {"x", "y", "z"} <= columns.keys():
            raise ValueError(
                f"{self.path}: the clouds of {self.topic} have the fields "
                f"{[*columns]}, expected x, y and z among them"
            )
        for name in ("x", "y", "z", *INTENSITIES):
            if name in columns and columns[name].ndim > 1:
                raise ValueError(
                    f"{self.path}: message {index} of {self.topic}: field {name} holds "
                    f"{columns[name].shape[1]:,} numbers a point, expected 1"
                )
        xyz = np.stack([columns[name] for name in "xyz"], -1)
        seen = np.isfinite(xyz).all(-1) & xyz.any(-1)
        return {name: column[seen] for name, column in columns.items()}

    def decode(self, index: int) -> Float[np.ndarray, "point 4"]:
        """Return x, y, z and intensity of cloud `index`."""
        columns = self.read_points(index)
        found = [columns[name] for name in INTENSITIES if name in columns]
        intensity = found[0] if found else np.zeros_like(columns["x"])
        table = [*(columns[name] for name in "xyz"), intensity]
        return np.stack(table, -1, dtype=np.float32, casting="same_kind")


def open_bag(path: Path | str, *, topic: str | None = None) -> LidarStream:
    """Return the clouds of a bag; `topic` is optional if only one topic holds clouds.

    Raises ValueError for a bag that is damaged or holds no clouds, and UsageError for a
    topic that does not exist or holds no clouds.
    """
    topics = bag_topics(path)
    clouds = [name for name, (kind, _) in topics.items() if is_cloud_type(kind)]
    if topic is None and len(clouds) == 1:
        topic = clouds[0]
    if not clouds:
        named = ", ".join(f"{name} ({kind})" for name, (kind, _) in topics.items())
        raise ValueError(
            f"{path} holds no clouds, expected PointCloud2 or CustomMsg, found "
            f"{named or 'no topics'}"
        )
    if topic not in clouds:
        asked = f"no clouds on {topic}" if topic else f"{len(clouds)} topics of clouds"
        raise UsageError(f"{path}: {asked}, name one of {', '.join(clouds)}")
    return LidarStream(Path(path), topic, topics[topic][0])


def bag_topics(path: Path | str) -> dict[str, tuple[str, int]]:
    """Return type and number of messages of every topic, from the bag's index."""
    with READING:
        topics = _reader(Path(path)).topics.items()
        return {name: (str(info.msgtype), info.msgcount) for name, info in topics}


def bag_definition(path: Path | str, topic: str) -> str:
    """Return the definition of a topic's messages, "" if the bag does not hold it."""
    with READING:
        found = [c for c in _reader(Path(path)).connections if c.topic == topic]
    text = found[0].msgdef.data if found else ""
    return "" if str(text).startswith("IDL") else str(text)


def bag_times(path: Path | str) -> dict[str, Float[np.ndarray, " message"]]:
    """Return the times of recording of each topic's messages, in seconds, rising.

    No message is decoded. Raises ValueError for a damaged bag.
    """
    times: dict[str, list[int]] = {}
    with READING:
        reader = _reader(Path(path))
        try:
            for connection, time, _ in reader.messages():
                times.setdefault(connection.topic, []).append(time)
        except Exception as error:
            raise ValueError(_damaged(Path(path), error)) from error
    return {topic: np.array(stamps) / NS for topic, stamps in times.items()}


def _reader(path) -> Any:
    """Return the open reader of a bag, one for each process."""
    if not path.exists():
        raise FileNotFoundError(f"no such bag: {path}")
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    for file in files:
        if not file.is_dir():
            open_file(file).close()  # refuses pipes and devices
    stats = [file.stat() for file in files]
    version = tuple((stat.st_mtime_ns, stat.st_size) for stat in stats)
    return _open_reader(path, os.getpid(), version)


@functools.lru_cache(maxsize=64)
def _open_reader(path, _process, _version):
    try:
        from rosbags import rosbag1, rosbag2
    except ImportError as error:
        raise ImportError("bags need rosbags: pip install 'jradar[ros]'") from error
    limit_rosbags()
    try:
        reader = (rosbag1 if path.suffix == ".bag" else rosbag2).Reader(path)
        reader.open()
    except Exception as error:  # a damaged file can raise anything
        raise ValueError(_damaged(path, error)) from error
    return reader


def _damaged(path, error):
    if "Profile is not ros2" in str(error):
        return (
            f"{path} is an MCAP file without ROS messages, expected a ROS 2 bag: "
            "Foxglove opens it"
        )
    parts = {part.suffix for part in path.iterdir()} if path.is_dir() else {path.suffix}
    repair = "ros2 bag reindex FOLDER, or sqlite3 FILE.db3 .recover"
    if ".bag" in parts:
        repair = f"rosbag reindex {path}"
    elif ".mcap" in parts:
        repair = f"mcap recover {path if path.is_file() else 'FILE.mcap'} -o new.mcap"
    return (
        f"{path} is not a whole bag ({type(error).__name__}: {error}): if the "
        f"recording was cut off, try `{repair}`"
    )
