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
        writer = rosbag1.Writer(path)
        if compressed:
            formats = rosbag1.Writer.CompressionFormat
            writer.set_compression(formats[compressed.upper()])
        serialize = store.serialize_ros1
    else:
        plugin = rosbag2.StoragePlugin["SQLITE3" if container == "sqlite" else "MCAP"]
        writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
        if compressed:
            writer.set_compression(
                rosbag2.CompressionMode[compressed.upper()],
                rosbag2.CompressionFormat.ZSTD,
            )
        serialize = store.serialize_cdr
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


FIELDS = [  # name, PointField type, dtype, in an order of its own
    ("z", 7, "f4"),
    ("intensity", 4, "u2"),
    ("x", 7, "f4"),
    ("ring", 2, "u1"),
    ("y", 7, "f4"),
    ("timestamp", 8, "f8"),
]


def point_cloud2(columns, stamp, big=False, height=1, gap=3, row_gap=0):
    """Each field after a gap, a gap after each row; packed number by number."""
    order = ">" if big else "<"

    def make(store):
        field = store.types["sensor_msgs/msg/PointField"]
        step, fields = gap, []
        for name, kind, form in FIELDS:
            fields.append(field(name, step, kind, 1))
            step += np.dtype(form).itemsize + gap
        count = len(columns["x"])
        width = count // height
        data = bytearray()
        for i in range(count):
            record = bytearray(b"\xaa" * step)
            for (name, _, form), place in zip(FIELDS, fields, strict=True):
                code = {"f4": "f", "u2": "H", "u1": "B", "f8": "d"}[form]
                struct.pack_into(order + code, record, place.offset, columns[name][i])
            data += record
            if (i + 1) % width == 0:
                data += b"\xbb" * row_gap
        row = width * step + row_gap
        return store.types[CLOUD](
            header(store, stamp),
            height,
            width,
            fields,
            big,
            step,
            row,
            np.frombuffer(bytes(data), np.uint8),
            False,
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
        return store.types[IMU](
            header=header(store, stamp, "base"),
            orientation=store.types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
            orientation_covariance=np.full(9, -1.0),
            angular_velocity=vector(*record[3:].tolist()),
            angular_velocity_covariance=np.full(9, -2.0),
            linear_acceleration=vector(*record[:3].tolist()),
            linear_acceleration_covariance=np.full(9, -3.0),
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
