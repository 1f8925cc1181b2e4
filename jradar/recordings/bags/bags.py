"""LiDAR clouds and IMUs in ROS bags, read by the package `rosbags`, without ROS.

    recording.bag                     ROS 1
    folder with metadata.yaml         ROS 2, SQLite or MCAP; or a single .db3 or .mcap

If a single .mcap was cut off, its whole messages are read, and a note says so.
`messages` lists the types of messages that hold clouds. An IMU that lies still with z
upwards measures a specific force of +9.81 m/s^2 along z.
"""

import contextlib
import functools
import itertools
import os
import struct
import threading
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from jradar.errors import UsageError, optional
from jradar.files import open_file
from jradar.recordings.bags.messages import (
    NS,
    decode_cloud,
    decode_imu,
    is_cloud_type,
    stamp_ns,
)
from jradar.recordings.recording import Imu, Stream

SUFFIXES = (".bag", ".mcap", ".db3")
INTENSITIES = ("intensity", "reflectivity", "i")
LAST_NS = 1 << 62  # a later time is damaged
MOST_METADATA = 1 << 20  # bytes of a ROS 2 bag's metadata.yaml
OTHER_CLOCK_S = 10.0  # a larger offset between two clocks is reported
IMU = "sensor_msgs/msg/Imu"
RATE, FORCE = slice(13, 16), slice(25, 28)  # of the numbers of a message
STANDARD_GRAVITY = 9.80665
MOST_IN_G = 3.0  # a smaller mean of |force| is in units of gravity: Livox's IMUs
READING = threading.Lock()  # all streams of a bag share its file position


class TopicStream(Stream):
    """The messages of one topic, decoded when they are accessed."""

    stamps: np.ndarray

    def __init__(
        self,
        path: Path,
        topic: str,
        decode: Callable[[bytes], Any],
        *,
        sensor: str,
        has_header: bool = True,
        on_recorders_clock: bool = False,
        extract: Callable[[bytes], Any] | None = None,
    ):
        """Read the times of all messages of `topic`.

        `sensor` names the sensor in notes. Messages without a header have their times
        of recording. Stamps of another clock are moved `on_recorders_clock`, or only
        noted. `extracted` is what `extract` returns for each message.
        """
        self.path, self.topic, self._sensor = path, topic, sensor
        self._moves = on_recorders_clock
        is_ros1 = path.suffix == ".bag"
        found, self.extracted = [], []
        for _, time, raw in messages(path, topic):
            found.append((time, stamp_ns(raw, is_ros1=is_ros1)))
            if extract is not None:
                self.extracted.append(extract(raw))
        self._times, headers = np.array(found, np.int64).reshape(-1, 2).T
        seconds, notes = self._times / NS, bag_notes(path)
        if has_header:
            seconds, of_times = self._stamps(headers)
            notes += of_times
        super().__init__(lambda i: self.decoded(i, decode), len(found), seconds, notes)

    def decoded(self, index: int, decode: Callable[[bytes], Any]) -> Any:
        """Return what `decode` makes of message `index`; errors name it."""
        time = int(self._times[index])  # several messages may have the same time
        before = int(np.searchsorted(self._times, time))
        near = messages(self.path, self.topic, time, time + 1)
        with contextlib.closing(near):
            found = next(itertools.islice(near, index - before, None), None)
        if found is None:
            raise ValueError(f"{self.path} changed while it was read: open it again")
        try:
            return decode(found[-1])
        except Exception as error:  # a damaged message can raise anything
            raise ValueError(
                f"{self.path}: message {index} of {self.topic}: {error}"
            ) from error

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
            used = "are moved by that" if self._moves else "are used"
            return headers / NS + late * self._moves, (
                f"{self.topic}: the {self._sensor}'s clock is {late:,.3f} s behind the "
                f"recorder's; the {self._sensor}'s stamps {used}",
            )
        return headers / NS, ()


class LidarStream(TopicStream):
    """Clouds of one topic: float32 [point, 4], x y z intensity, in the LiDAR's frame.

    Points at (0, 0, 0), and those that are not finite, are missing returns and removed.
    """

    def __init__(
        self, path: Path, topic: str, kind: str, *, on_recorders_clock: bool = False
    ):
        """Read the stamps of all clouds of `topic`; the clock as in `TopicStream`."""
        self._kind, self._is_ros1 = kind, path.suffix == ".bag"
        super().__init__(
            *(path, topic, self._cloud),
            sensor="LiDAR",
            on_recorders_clock=on_recorders_clock,
        )

    def read_points(self, index: int) -> dict[str, np.ndarray]:
        """Return all fields of the points of cloud `index` by name.

        Livox's `offset_time` is in nanoseconds after the cloud's stamp.
        """
        return self.decoded(index, self._points)

    def _points(self, raw: bytes) -> dict[str, np.ndarray]:
        points = decode_cloud(raw, self._kind, is_ros1=self._is_ros1)
        columns = {name: points[name] for name in points.dtype.names or ()}
        if not {"x", "y", "z"} <= columns.keys():
            raise ValueError(
                f"its fields are {[*columns]}, expected x, y and z among them"
            )
        for name in ("x", "y", "z", *INTENSITIES):
            if name in columns and columns[name].ndim > 1:
                raise ValueError(
                    f"field {name} holds {columns[name].shape[1]:,} numbers a point, "
                    "expected 1"
                )
        xyz = np.stack([columns[name] for name in "xyz"], -1)
        seen = np.isfinite(xyz).all(-1) & xyz.any(-1)
        return {name: column[seen] for name, column in columns.items()}

    def _cloud(self, raw: bytes) -> Float[np.ndarray, "point 4"]:
        columns = self._points(raw)
        found = [columns[name] for name in INTENSITIES if name in columns]
        intensity = found[0] if found else np.zeros_like(columns["x"])
        table = [*(columns[name] for name in "xyz"), intensity]
        return np.stack(table, -1, dtype=np.float32, casting="same_kind")


def open_bag(path: Path | str, *, topic: str | None = None) -> LidarStream:
    """Return the clouds of a bag; `topic` is optional if only one topic holds clouds.

    Raises ValueError for a damaged bag, and UsageError as `topic_of`.
    """
    name, kind = topic_of(path, topic, is_cloud_type, "clouds")
    return LidarStream(Path(path), name, kind)


def open_imu(
    path: Path | str, *, topic: str | None = None, on_recorders_clock: bool = False
) -> tuple[Imu, tuple[str, ...]]:
    """Return the IMU in a bag, and notes on it.

    `topic` is optional if only one holds sensor_msgs/Imu. If several records have the
    same time, the first is kept. Errors as in `open_bag`; the clock as in
    `TopicStream`.
    """
    topic, _ = topic_of(path, topic, IMU.__eq__, IMU)
    path = Path(path)
    decode = functools.partial(decode_imu, is_ros1=path.suffix == ".bag")
    try:
        stream = TopicStream(
            *(path, topic, decode),
            sensor="IMU",
            on_recorders_clock=on_recorders_clock,
            extract=decode,
        )
    except struct.error as error:
        raise ValueError(f"{path}: a message of {topic} is cut off: {error}") from error
    table, notes = np.array(stream.extracted), stream.notes
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


def topic_of(
    path: Path | str, topic: str | None, is_wanted: Callable[[str], bool], what: str
) -> tuple[str, str]:
    """Return name and type of the only topic of wanted types, or of the one named.

    Raises UsageError if there is none, and if there are several.
    """
    kinds = {name: kind for name, (kind, _) in bag_topics(path).items()}
    wanted = [name for name in kinds if is_wanted(kinds[name])]
    if topic is None and len(wanted) == 1:
        topic = wanted[0]
    if topic not in wanted:
        asked = f"no {what} on {topic}" if topic else f"{len(wanted)} topics of {what}"
        found = ", ".join(wanted or [f"{n} ({kind})" for n, kind in kinds.items()])
        raise UsageError(f"{path}: {asked}, name one of {found or 'no topics'}")
    return topic, kinds[topic]


def is_bag(path: Path) -> bool:
    """True for the name of a bag, and for a folder of ROS 2."""
    return path.suffix in SUFFIXES or (path / "metadata.yaml").is_file()


def bag_topics(path: Path | str) -> dict[str, tuple[str, int]]:
    """Return type and number of messages of every topic, from the bag's index."""
    with _opened(Path(path)) as reader:
        topics = reader.topics.items()
        return {name: (str(info.msgtype), info.msgcount) for name, info in topics}


def bag_notes(path: Path | str) -> tuple[str, ...]:
    """Return notes on what could not be read, if a bag was cut off."""
    with _opened(Path(path)) as reader:
        storage = getattr(reader, "storage", None)
        return getattr(storage, "notes", ())


def bag_definition(path: Path | str, topic: str) -> str:
    """Return the definition of a topic's messages, or "" if the bag holds none."""
    with _opened(Path(path)) as reader:
        found = [c for c in reader.connections if c.topic == topic]
        text = str(found[0].msgdef.data) if found else ""
    return "" if text.startswith("IDL") else text


def bag_times(path: Path | str) -> dict[str, Float[np.ndarray, " message"]]:
    """Return the times of recording of each topic's messages, in seconds, rising.

    No message is decoded. Raises ValueError for a damaged bag.
    """
    times: dict[str, list[int]] = {}
    for topic, time, _ in messages(Path(path)):
        times.setdefault(topic, []).append(time)
    return {topic: np.array(stamps) / NS for topic, stamps in times.items()}


def messages(
    path: Path,
    topic: str | None = None,
    start: int | None = None,
    stop: int | None = None,
) -> Generator[tuple[str, int, bytes], None, None]:
    """Yield topic, time in nanoseconds and bytes of the messages of one topic, or all.

    The bag is locked until the last message.
    """
    with _opened(path) as reader:
        chosen = [c for c in reader.connections if topic in (None, c.topic)]
        for connection, time, raw in reader.messages(chosen, start, stop):
            if not 0 <= time < LAST_NS:
                raise ValueError(f"a message has the time {time} ns")
            yield connection.topic, time, bytes(raw)


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Lock a bag and yield its reader, one for each process; errors name the bag."""
    if not path.exists():
        raise FileNotFoundError(f"no such bag: {path}")
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    for file in files:
        if not file.is_dir():  # refuses pipes, devices, and YAML that takes hours
            limit = MOST_METADATA if file.suffix == ".yaml" else None
            open_file(file, limit=limit).close()
    stats = [file.stat() for file in files]
    version = tuple((stat.st_mtime_ns, stat.st_size) for stat in stats)
    with READING:
        try:
            yield _reader(path, os.getpid(), version)
        except ImportError:
            raise
        except Exception as error:  # a damaged file can raise anything
            raise ValueError(_damaged(path, error)) from error


@functools.lru_cache(maxsize=64)
def _reader(path, _process, _version):
    kind = "rosbag1" if path.suffix == ".bag" else "rosbag2"
    optional(f"rosbags.{kind}", need="bags need rosbags", extra="ros")
    from jradar.recordings.bags.readers import open_reader

    return open_reader(path)


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
