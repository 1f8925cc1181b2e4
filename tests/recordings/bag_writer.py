"""Bags in three containers with clouds of every layout, for tests; needs rosbags."""

import struct

import numpy as np
import pytest

rosbag1 = pytest.importorskip("rosbags.rosbag1", reason="pip install 'jradar[ros]'")
from rosbags import rosbag2  # noqa: E402
from rosbags.typesys import (  # noqa: E402
    Stores,
    get_types_from_msg,
    get_typestore,
)

POINT, LIVOX = "livox_ros_driver2/msg/CustomPoint", "livox_ros_driver2/msg/CustomMsg"
CLOUD, IMU = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/Imu"
IQ, FRAME = "xwr_msgs/msg/IQ", "mmWave/msg/data_frame"
ARRAY = "std_msgs/msg/Int16MultiArray"
MESSAGES = {
    POINT: "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\n"
    "uint8 reflectivity\nuint8 tag\nuint8 line\n",
    LIVOX: "std_msgs/Header header\nuint64 timebase\nuint32 point_num\n"
    "uint8 lidar_id\nuint8[3] rsvd\nlivox_ros_driver2/CustomPoint[] points\n",
    IQ: "std_msgs/Header header\n\nstd_msgs/Int16MultiArray iq # raw\nbool complete\n",
    FRAME: "int16[] data\n",
}
CONTAINERS = ("bag", "sqlite", "mcap")
START = 1_700_000_000 * 10**9  # nanoseconds
TENTH = 10**8


def typestore(container):
    ros1 = container == "bag"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    for name, text in MESSAGES.items():
        store.register(get_types_from_msg(text, name))
    return store


STORES = {name: typestore(name) for name in CONTAINERS}


def write_bag(folder, container, messages, compressed=""):
    """`messages` are (topic, type, bag time, function of the store: message or bytes).

    `compressed` is the writer's word: bz2 or lz4 in ROS 1, message or file in ROS 2.
    """
    store = STORES[container]
    folder.mkdir(exist_ok=True)
    path = folder / ("a.bag" if container == "bag" else container)
    if container == "bag":
        writer, serialize = rosbag1.Writer(path), store.serialize_ros1
        how = (rosbag1.Writer.CompressionFormat[compressed.upper() or "LZ4"],)
    else:
        plugin = rosbag2.StoragePlugin["SQLITE3" if container == "sqlite" else "MCAP"]
        writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
        serialize = store.serialize_cdr
        mode = rosbag2.CompressionMode[compressed.upper() or "NONE"]
        how = mode, rosbag2.CompressionFormat.ZSTD
    if compressed:
        writer.set_compression(*how)
    with writer:
        connections = {}
        for topic, kind, time, make in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            made = make(store)
            data = made if isinstance(made, bytes) else serialize(made, kind)
            writer.write(connections[topic], time, data)
    return path


def files_of(path):
    """The file of a bag, or the files with the messages in its folder."""
    return [path] if path.is_file() else [*path.glob("*.db3"), *path.glob("*.mcap")]


def header(store, stamp, frame="livox_frame"):
    time = store.types["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9))
    kind = store.types["std_msgs/msg/Header"]
    ros1 = "seq" in kind.__dataclass_fields__
    return kind(**{"seq": 7} if ros1 else {}, stamp=time, frame_id=frame)


def livox_rows(count, seed=0):
    rng = np.random.default_rng(seed)
    xyz = rng.normal(size=(count, 3)).astype(np.float32)
    numbers = rng.integers(0, 256, (count, 3))
    return [(1000 * i, *xyz[i].tolist(), *numbers[i].tolist()) for i in range(count)]


def livox(rows, stamp, frame="livox_frame"):
    def make(store):
        points = [store.types[POINT](*row) for row in rows]
        rsvd = np.zeros(3, np.uint8)
        fields = (header(store, stamp, frame), stamp, len(rows), 3, rsvd, points)
        return store.types[LIVOX](*fields)

    return make


def livox_bag(folder, container, clouds, start=START, step=TENTH, topic="/l", **more):
    """A bag of Livox clouds, one every `step` nanoseconds."""
    stamps = range(start, start + step * len(clouds), step)
    each = zip(clouds, stamps, strict=True)
    messages = [(topic, LIVOX, stamp, livox(rows, stamp)) for rows, stamp in each]
    return write_bag(folder, container, messages, **more)


# Name, PointField type, struct's letter, in an order of its own.
FIELDS = [("z", 7, "f"), ("intensity", 4, "H"), ("x", 7, "f"), ("ring", 2, "B")]
FIELDS += [("y", 7, "f"), ("timestamp", 8, "d")]


def point_cloud2(columns, stamp, big=False, height=1, gap=3, row_gap=0):
    """Each field after a gap, a gap after each row; packed point by point."""
    names, _, letters = zip(*FIELDS, strict=True)
    gaps = gap * "x"
    form = (">" if big else "<") + gaps + "".join(letter + gaps for letter in letters)
    rows = zip(*(columns[name].tolist() for name in names), strict=True)
    points = [struct.pack(form, *row) for row in rows]
    step, width = struct.calcsize(form), len(points) // height
    data = b"".join(
        b"".join(points[at : at + width]) + row_gap * b"\xbb"
        for at in range(0, len(points), max(width, 1))
    )

    def make(store):
        field, fields, at = store.types["sensor_msgs/msg/PointField"], [], gap
        for name, kind, letter in FIELDS:
            fields.append(field(name, at, kind, 1))
            at += struct.calcsize(letter) + gap
        return store.types[CLOUD](
            *(header(store, stamp), height, width, fields, big),
            *(step, width * step + row_gap, np.frombuffer(data, np.uint8), False),
        )

    return make


def columns(count, seed=0):
    rng = np.random.default_rng(seed)
    return {
        **{name: rng.normal(size=count).astype(np.float32) for name in "xyz"},
        "intensity": rng.integers(0, 65536, count),
        "ring": rng.integers(0, 256, count),
        "timestamp": 1.7e18 + rng.random(count),
    }


def imu(record, stamp):
    """Force and angular velocity, and other numbers that must not be read."""

    def make(store):
        vector = store.types["geometry_msgs/msg/Vector3"]
        turn = store.types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        return store.types[IMU](
            *(header(store, stamp, "base"), turn, np.full(9, -1.0)),
            *(vector(*record[3:].tolist()), np.full(9, -2.0)),
            *(vector(*record[:3].tolist()), np.full(9, -3.0)),
        )

    return make


def raw_samples(kind, words, stamp):
    """A frame of int16 in a message of one of the three types."""

    def make(store):
        if kind == FRAME:
            return store.types[kind](data=words)
        layout = store.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
        array = store.types[ARRAY](layout=layout, data=words)
        if kind == ARRAY:
            return array
        return store.types[kind](header(store, stamp), array, True)

    return make
