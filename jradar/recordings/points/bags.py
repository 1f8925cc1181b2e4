"""Points that a radar's driver published, in ROS bags.

    sensor_msgs/PointCloud2                 with a Doppler velocity, an SNR, or an RCS
    radar_msgs/RadarScan                    range, azimuth, elevation of each return
    ars430_ros_publisher/RadarPacket        several packets make a frame; ROS 1

A PointCloud2 of other fields is a LiDAR's, unless its topic is named. `bags.rig` reads
what else the bag holds.
"""

import contextlib
import struct
from functools import partial
from pathlib import Path

import numpy as np

from jradar.errors import UsageError
from jradar.recordings.bags.bags import TopicStream, bag_topics, is_bag, messages
from jradar.recordings.bags.messages import (
    after_header,
    decode_cloud,
    frame_of,
    is_cloud_type,
)
from jradar.recordings.bags.raw import holds_samples
from jradar.recordings.bags.rig import read_rig
from jradar.recordings.points.fields import (
    NAMES,
    OURS,
    are_points,
    are_radar_points,
    match_fields,
)
from jradar.recordings.points.frames import points_recording
from jradar.recordings.recording import Format, Recording, Stream

CLOUD = "sensor_msgs/msg/PointCloud2"
SCAN, PACKET = "radar_msgs/msg/RadarScan", "ars430_ros_publisher/msg/RadarPacket"
SCAN_POINT = ("range", "azimuth", "elevation", "doppler_velocity", "amplitude")
PACKET_POINT = (
    *("posX", "posY", "posZ", "VrelRad", "AzAng", "ElAng", "RCS", "RangeVar"),
    *("VrelRadVar", "AzAngVar", "ElAngVar", "SNR"),
)
PACKET_HEAD = struct.Struct("<BIIffI")  # event, time, measurement, .., detections


def open_points_bag(path: Path | str, *, topic: str | None = None) -> Recording:
    """Open the points of the only topic of a radar, or of the one named.

    Raises UsageError without such a topic, or with several; ValueError for a damaged
    bag.
    """
    path = Path(path)
    seen = {name: _columns_of(path, name, kind) for name, kind in _topics(path)}
    radars = [n for n, names in seen.items() if _is_radar(names, named=n == topic)]
    found = [name for name in radars if topic in (None, name)]
    if len(found) != 1:
        shown = "; ".join(f"{n} ({', '.join(c)})" for n, c in seen.items())
        raise UsageError(
            f"{path}: {len(found)} topics of a radar's points, expected one with a "
            f"field named {', '.join(NAMES['velocity'][:5])}, snr or rcs, or the name "
            f"of one; the bag has {shown or 'no clouds'}"
        )
    (name,) = found
    kind, is_ros1 = dict(_topics(path))[name], path.suffix == ".bag"
    stream = TopicStream(
        path,
        name,
        partial(_decode, kind=kind, is_ros1=is_ros1),
        sensor="radar",
        on_recorders_clock=True,
        extract=partial(_about, kind=kind, is_ros1=is_ros1),
    )
    frames = _measurements(stream) if kind == PACKET else stream
    frames.notes = (f"points are on the topic {name}", *frames.notes)
    if len(places := {place for place, _ in stream.extracted}) > 1:
        frames.notes += (
            f"{name} mixes the frames of reference {', '.join(sorted(places))}: they "
            "are taken as one",
        )
    drawn = [name for name, names in seen.items() if OURS in names]
    rig, notes = read_rig(path, name, radars=[*radars, *drawn])
    return points_recording(path, frames, notes=notes, **rig._asdict())


def holds_points(path: Path) -> bool:
    """True for a bag with a topic of a radar's points, and without raw samples."""
    if not is_bag(path) or not path.exists() or holds_samples(path):
        return False
    try:
        topics = [*_topics(path)]
        return any(
            kind != CLOUD or _is_radar(_columns_of(path, name, kind))
            for name, kind in topics
        )
    except (ImportError, OSError, ValueError):
        return False


READER = Format(
    "a ROS bag of a radar's points: PointCloud2, RadarScan, RadarPacket",
    holds_points,
    open_points_bag,
    ("topic",),
)


def holds_clouds(path: Path) -> bool:
    """True for a bag with clouds of any sensor, and without raw samples."""
    if not is_bag(path) or holds_samples(path):
        return False
    return any(is_cloud_type(kind) for kind, _ in bag_topics(path).values())


def _topics(path: Path) -> list[tuple[str, str]]:
    """Return name and type of the topics with messages that may be a radar's points."""
    known = (CLOUD, SCAN, *([PACKET] if path.suffix == ".bag" else ()))
    topics = bag_topics(path).items()
    return [(name, kind) for name, (kind, count) in topics if kind in known and count]


def _columns_of(path: Path, topic: str, kind: str) -> list[str]:
    """Return the columns of the first message of a topic."""
    decode = partial(_decode, kind=kind, is_ros1=path.suffix == ".bag")
    raw = next((raw for *_, raw in messages(path, topic)), None)
    if raw is None:
        raise ValueError(f"{path}: no message is on the topic {topic}")
    try:
        return [*decode(raw)]
    except (ValueError, struct.error) as error:
        raise ValueError(f"{path}: message 0 of {topic}: {error}") from error


def _is_radar(names: list[str], *, named: bool = False) -> bool:
    return are_radar_points(names) or (named and are_points(match_fields(names)))


def _decode(raw: bytes, *, kind: str, is_ros1: bool) -> dict[str, np.ndarray]:
    """Return the columns of a message."""
    if kind == CLOUD:
        points = decode_cloud(raw, kind, is_ros1=is_ros1)
        columns = {name: points[name] for name in points.dtype.names or ()}
        return {name: column for name, column in columns.items() if column.ndim == 1}
    names = SCAN_POINT if kind == SCAN else PACKET_POINT
    if kind == SCAN:
        order, start = after_header(raw, is_ros1, alignment=4)
        (count,), start = struct.unpack_from(f"{order}I", raw, start), start + 4
    else:
        order, start = after_header(raw, is_ros1)
        count, start = PACKET_HEAD.unpack_from(raw, start)[-1], start + PACKET_HEAD.size
    if start + 4 * len(names) * count > len(raw):
        raise ValueError(
            f"{count:,} points of {4 * len(names)} bytes do not fit in its "
            f"{len(raw):,} bytes"
        )
    table = np.frombuffer(raw, f"{order}f4", count * len(names), start)
    return dict(zip(names, table.reshape(-1, len(names)).T, strict=True))


def _about(raw: bytes, *, kind: str, is_ros1: bool) -> tuple[str, int]:
    """Return the frame of reference and, of a whole packet, its measurement."""
    place, number = frame_of(raw, is_ros1=is_ros1), 0
    if kind == PACKET:
        with contextlib.suppress(struct.error):  # reading it raises
            _, start = after_header(raw, is_ros1)
            number = PACKET_HEAD.unpack_from(raw, start)[2]
    return place, number


def _measurements(stream: TopicStream) -> Stream:
    """Return frames of all packets of one measurement."""
    numbers = np.array([number for _, number in stream.extracted])
    starts = np.flatnonzero(np.diff(numbers, prepend=numbers[0] - 1))
    ends = np.append(starts[1:], len(numbers))

    def read(index: int) -> dict[str, np.ndarray]:
        parts = [stream[k] for k in range(starts[index], ends[index])]
        return {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}

    return Stream(read, len(starts), stream.stamps[starts], stream.notes)
