"""Clouds in ROS messages: bytes to structured arrays of points.

    sensor_msgs/PointCloud2      any fields and padding
    livox_.../CustomMsg          a table: 19 bytes a point in ROS 1, 20 in ROS 2's CDR,
                                 where the last point has no padding

The serialisation is that of ROS 1, or ROS 2's CDR.
"""

import functools
import struct
from typing import Any

import numpy as np

LIVOX_POINT = {
    **{"offset_time": "u4", "x": "f4", "y": "f4", "z": "f4"},
    **{"reflectivity": "u1", "tag": "u1", "line": "u1"},
}
FIELD_FORMATS = ("", "i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")  # of PointCloud2


def is_cloud_type(kind: str) -> bool:
    """True for the types of messages that `open_bag` reads."""
    return kind == "sensor_msgs/msg/PointCloud2" or (
        kind.startswith("livox_") and kind.endswith("/msg/CustomMsg")
    )


def decode_cloud(raw: bytes, kind: str, *, is_ros1: bool) -> np.ndarray:
    """Return the points of a message of type `kind` as a structured array.

    Raises ValueError or struct.error for a damaged message.
    """
    decode = _livox if kind.endswith("CustomMsg") else _point_cloud2
    return decode(raw, is_ros1)


@functools.cache
def _point_cloud2_decoders():
    from rosbags.typesys import Stores, get_typestore

    ros1 = get_typestore(Stores.ROS1_NOETIC).deserialize_ros1
    return ros1, get_typestore(Stores.ROS2_HUMBLE).deserialize_cdr


def _point_cloud2(raw, is_ros1):
    try:
        decode = _point_cloud2_decoders()[not is_ros1]
        message: Any = decode(raw, "sensor_msgs/msg/PointCloud2")
    except Exception as error:  # a damaged message can raise anything
        raise ValueError(f"not a whole PointCloud2: {error}") from error
    order = ">" if message.is_bigendian else "<"
    fields = {}
    for field in message.fields:  # PCL names several padding fields alike
        fields.setdefault(field.name, field)
    for field in fields.values():
        if not 0 < field.datatype < len(FIELD_FORMATS):
            raise ValueError(
                f"field {field.name} has the unknown type {field.datatype}"
            )
    step, height, width = message.point_step, message.height, message.width
    points = np.dtype(
        {
            "names": [*fields],
            "formats": [
                (order + FIELD_FORMATS[f.datatype], (f.count,) if f.count > 1 else ())
                for f in fields.values()
            ],
            "offsets": [field.offset for field in fields.values()],
            "itemsize": step,
        }
    )
    row = message.row_step if height > 1 else width * step
    if row < width * step or height * row > len(message.data):
        raise ValueError(
            f"{height} x {width} points of {step} bytes in rows of {row} bytes do not "
            f"fit in its {len(message.data):,} bytes of data"
        )
    table = np.ndarray((height, width), points, message.data, strides=(row, step))
    return table.ravel()


def _livox(raw, is_ros1):
    order, body, align = "<", memoryview(raw), 1
    if is_ros1:
        body = body[4:]  # the header's sequence number, absent in ROS 2
    else:
        order, body, align = "<" if raw[1:2] == b"\1" else ">", body[4:], 8
    (name,) = struct.unpack_from(order + "8xI", body)
    start = -(-(12 + name) // align) * align
    # timebase u64, point_num u32, lidar_id u8, rsvd u8[3], and the array's own count
    (count,) = struct.unpack_from(order + "16xI", body, start)
    size = 19 if is_ros1 else 20
    points = np.dtype(
        {
            "names": [*LIVOX_POINT],
            "formats": [order + form for form in LIVOX_POINT.values()],
            "itemsize": size,
        }
    )
    table = bytes(body[start + 20 :])
    unpadded = count * size - (count > 0 and not is_ros1)
    if not unpadded <= len(table) <= unpadded + 3:
        raise ValueError(
            f"{count:,} points of {size} bytes need {unpadded:,} bytes, the message "
            f"holds {len(table):,}"
        )
    return np.frombuffer(table + b"\0", points, count)
