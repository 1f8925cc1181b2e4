"""Messages of MCAP files and ROS 2 bags, as the packages of others read them."""

from typing import Any, NamedTuple

import numpy as np
import pytest


class Message(NamedTuple):
    """Content: columns of a cloud, pixels, or places by the names of two frames."""

    topic: str
    kind: str
    time_ns: int
    stamps: set[int]  # of the message, or of its transforms, nanoseconds
    frames: set[str]
    content: Any


def bag_messages(path):
    """By rosbags."""
    highlevel = pytest.importorskip("rosbags.highlevel")
    with highlevel.AnyReader([path]) as reader:
        for connection, time_ns, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            yield read(connection.topic, connection.msgtype, time_ns, message)


def mcap_messages(path):
    """By the package of MCAP's authors."""
    reader = pytest.importorskip("mcap.reader")
    decoder = pytest.importorskip("mcap_protobuf.decoder")
    with path.open("rb") as file:
        made = reader.make_reader(file, decoder_factories=[decoder.DecoderFactory()])
        for schema, channel, raw, message in made.iter_decoded_messages():
            yield read(channel.topic, schema.name, raw.log_time, message)


READERS = {"out.mcap": mcap_messages, "out.ros2": bag_messages}


def read(topic, kind, time_ns, message):
    if kind.endswith("Log"):  # which has no frame of reference
        text = getattr(message, "message", "") or message.msg
        return Message(topic, kind, time_ns, {time_ns}, set(), text)
    parts = getattr(message, "transforms", [message])
    stamps, frames = zip(*map(stamp_and_frame, parts), strict=True)
    if hasattr(message, "transforms"):
        content = {(frame_of(one), one.child_frame_id): place_of(one) for one in parts}
    elif hasattr(message, "fields"):
        content = table_of(message)
    else:
        assert (message.encoding, message.step) == ("mono8", message.width)
        pixels = np.frombuffer(message.data, np.uint8)
        content = pixels.reshape(message.height, message.width)
    return Message(topic, kind, time_ns, {*stamps}, {*frames}, content)


def stamp_and_frame(one):
    if head := getattr(one, "header", None):  # of ROS
        return head.stamp.sec * 10**9 + head.stamp.nanosec, head.frame_id
    return one.timestamp.ToNanoseconds(), frame_of(one)


def frame_of(one):
    if hasattr(one, "parent_frame_id"):
        return one.parent_frame_id
    return getattr(one, "header", one).frame_id


def place_of(one):
    moved = getattr(one, "transform", one)
    place = [getattr(moved.translation, axis) for axis in "xyz"]
    return place + [getattr(moved.rotation, axis) for axis in "xyzw"]


def table_of(message):
    """The columns of a cloud by name, all of float32."""
    fields = message.fields
    if hasattr(message, "point_step"):  # of ROS
        stride, kinds = message.point_step, {(f.datatype, f.count) for f in fields}
        assert kinds == {(7, 1)} and message.height == 1
        assert message.is_dense and not message.is_bigendian
        assert message.row_step == message.width * stride == len(message.data)
    else:
        stride = message.point_stride
        assert {f.type for f in fields} == {7} and message.pose.orientation.w == 1
    kind = {"names": [f.name for f in fields], "offsets": [f.offset for f in fields]}
    kind |= {"formats": ["<f4"] * len(fields), "itemsize": stride}
    table = np.frombuffer(message.data, np.dtype(kind))
    return {name: table[name] for name in table.dtype.names}
