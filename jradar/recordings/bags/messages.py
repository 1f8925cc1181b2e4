"""Decodes ROS messages into stamps, structured arrays of points, and numbers.

    sensor_msgs/PointCloud2      any fields and padding
    livox_.../CustomMsg          a table: 19 bytes a point in ROS 1, 20 in ROS 2's CDR,
                                 where the last point has no padding
    sensor_msgs/Imu              37 numbers after the header

Four bytes precede the stamp in both serialisations: the header's sequence number in
ROS 1, the encapsulation in ROS 2's CDR. Damaged messages raise ValueError or
struct.error.
"""

import functools
import struct
from typing import Any

import numpy as np

NS = 1_000_000_000
LIVOX_POINT = {
    **{"offset_time": "u4", "x": "f4", "y": "f4", "z": "f4"},
    **{"reflectivity": "u1", "tag": "u1", "line": "u1"},
}
TF = "tf2_msgs/msg/TFMessage"
TRANSFORMS = "geometry_msgs/TransformStamped[] transforms\n"
FIELD_FORMATS = ("", "i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")  # of PointCloud2


def is_cloud_type(kind: str) -> bool:
    """True for the types of messages that `open_bag` reads."""
    return kind == "sensor_msgs/msg/PointCloud2" or (
        kind.startswith("livox_") and kind.endswith("/msg/CustomMsg")
    )


def stamp_ns(raw: bytes, *, is_ros1: bool) -> int:
    """Return the nanoseconds in the header of a message; 0 if it is cut off."""
    form = f"{_order(raw, is_ros1)}4x{'I' if is_ros1 else 'i'}I"
    if len(raw) < struct.calcsize(form):
        return 0
    seconds, nanoseconds = struct.unpack_from(form, raw)
    return seconds * NS + nanoseconds


def frame_of(raw: bytes, *, is_ros1: bool) -> str:
    """Return the frame of reference in the header of a message; "" if it is cut off."""
    if len(raw) < 16:
        return ""
    (size,) = struct.unpack_from(f"{_order(raw, is_ros1)}12xI", raw)
    return raw[16 : 16 + size].rstrip(b"\0").decode(errors="replace")


def decode_imu(raw: bytes, *, is_ros1: bool) -> tuple[float, ...]:
    """Return orientation, angular velocity, acceleration, each with its covariance."""
    order, start = after_header(raw, is_ros1)
    return struct.unpack_from(f"{order}37d", raw, start)


def decode_cloud(raw: bytes, kind: str, *, is_ros1: bool) -> np.ndarray:
    """Return the points of a message of type `kind` as a structured array."""
    decode = _livox if kind.endswith("CustomMsg") else _point_cloud2
    return decode(raw, is_ros1)


def _order(raw: bytes, is_ros1: bool) -> str:
    return "<" if is_ros1 or raw[1:2] == b"\1" else ">"


def after_header(raw: bytes, is_ros1: bool, *, alignment: int = 8) -> tuple[str, int]:
    """Return the order of bytes, and where fields of `alignment` bytes begin."""
    order = _order(raw, is_ros1)
    (name,) = struct.unpack_from(f"{order}12xI", raw)
    aligned = -(-(12 + name) // alignment) * alignment
    return order, 16 + (name if is_ros1 else aligned - 12)


@functools.cache
def _decoders():
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    ros1, ros2 = map(get_typestore, (Stores.ROS1_NOETIC, Stores.ROS2_HUMBLE))
    ros1.register(get_types_from_msg(TRANSFORMS, TF))  # which ROS 2's store knows
    return ros1.deserialize_ros1, ros2.deserialize_cdr


def decode_message(raw: bytes, kind: str, *, is_ros1: bool) -> Any:
    """Return a message of ROS's own types; ValueError if it is damaged."""
    try:
        return _decoders()[not is_ros1](raw, kind)
    except Exception as error:  # a damaged message can raise anything
        name = kind.rpartition("/")[2]
        raise ValueError(f"not a whole {name}: {error}") from error


def _point_cloud2(raw, is_ros1):
    message = decode_message(raw, "sensor_msgs/msg/PointCloud2", is_ros1=is_ros1)
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
    order, start = after_header(raw, is_ros1)
    # timebase u64, point_num u32, lidar_id u8, rsvd u8[3], and the array's own count
    (count,) = struct.unpack_from(f"{order}16xI", raw, start)
    size = 19 if is_ros1 else 20
    points = np.dtype(
        {
            "names": [*LIVOX_POINT],
            "formats": [order + form for form in LIVOX_POINT.values()],
            "itemsize": size,
        }
    )
    table = raw[start + 20 :]
    unpadded = count * size - (count > 0 and not is_ros1)
    if not unpadded <= len(table) <= unpadded + 3:
        raise ValueError(
            f"{count:,} points of {size} bytes need {unpadded:,} bytes, the message "
            f"holds {len(table):,}"
        )
    return np.frombuffer(table + b"\0", points, count)
