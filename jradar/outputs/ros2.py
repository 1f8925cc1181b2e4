"""ROS 2 bags of frames, in MCAP storage, through rosbags; no ROS is needed.

/NAME/points          sensor_msgs/PointCloud2: x y z, and velocity, power .. as fields
/radar/range_azimuth  sensor_msgs/Image, mono8
/tf                   tf2_msgs/TFMessage of radar and LiDAR on the base, and of the
                      base in odom

Once a second the bag is completed, with its index and metadata.yaml. The next message
goes over the index:

    chunk | chunk | index        complete: any reader opens it
    chunk | chunk | chunk ..     until the next second: readers scan it
"""

import contextlib
import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from jradar.errors import optional
from jradar.outputs.clouds import point_table
from jradar.outputs.published import RADAR_FRAME, Published
from jradar.outputs.writers import exists, writing

FLOAT32 = 7  # of sensor_msgs/PointField
SAVED_S = 1.0  # by which a crash may shorten a bag
VERSION = 8  # of the bag's metadata, which ROS 2 Humble and later read


class BagWriter:
    """A bag in MCAP storage, a folder with metadata.yaml."""

    def __init__(self, path: Path):
        """Create the folder; UsageError if it exists, ImportError without rosbags."""
        rosbag2, typesys = _rosbags("rosbag2"), _rosbags("typesys")
        self._store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        self.path = path
        storage = rosbag2.StoragePlugin.MCAP
        try:
            self._bag = rosbag2.Writer(path, version=VERSION, storage_plugin=storage)
            self._bag.open()
        except rosbag2.WriterError:  # created since the caller looked
            raise exists(path) from None
        self._storage: Any = self._bag.storage
        self._connections: dict[str, Any] = {}
        self._qos = _reliable()
        self._end, self._index = 0, b""  # of the messages that are safe
        self._saved_s = -math.inf
        self._failed = False

    def write(self, frame: Published) -> None:
        """Write a frame; what is older than a second is safe from a crash.

        Raises OSError if the bag cannot be written, such as on a full disk. It then
        ends with the messages that were safe.
        """
        with self._or_end():
            self._write_all(frame)
        self.save()

    def save(self) -> None:
        """Complete the bag, once a second."""
        if time.monotonic() - self._saved_s >= SAVED_S:
            self.close()

    def close(self) -> None:
        """Write the index and the metadata."""
        if not self._failed and self._bag.storage is not None:
            with self._or_end():
                self._complete()

    def _write_all(self, frame: Published) -> None:
        header = self._header(frame, RADAR_FRAME)
        for name, cloud in frame.clouds.items():
            message = self._cloud(header, point_table(cloud))
            self._write(f"/{name}/points", message, frame)
        if frame.picture is not None:
            message = self._image(header, frame.picture)
            self._write("/radar/range_azimuth", message, frame)
        if frame.transforms:
            transforms = [
                self._transform(self._header(frame, parent), child, matrix)
                for parent, child, matrix in frame.transforms
            ]
            message = self._type("tf2_msgs/msg/TFMessage")(transforms=transforms)
            self._write("/tf", message, frame)

    def _complete(self) -> None:
        """Write the end of the bag, which the next frame goes over."""
        storage = self._storage
        if storage.chunk.bio.tell():
            storage.close_chunk()
        end = storage.bio.tell()
        self._bag.close()
        with storage.path.open("rb") as file:
            file.seek(end)
            self._index = file.read()
        self._end, self._saved_s = end, time.monotonic()

    def _go_on(self) -> None:
        """Open a bag that was completed, behind its last chunk."""
        file = self._storage.path.open("r+b")
        file.seek(self._end)
        file.truncate()
        self._storage.bio, self._bag.storage = file, self._storage

    @contextlib.contextmanager
    def _or_end(self) -> Iterator[None]:
        """End the bag with the messages that are safe if it cannot be written."""
        try:
            with writing(self.path):
                yield
        except OSError:
            self._failed = True
            with contextlib.suppress(OSError):
                self._storage.bio.close()  # which tries to write again
            with self._storage.path.open("r+b") as file:
                file.truncate(self._end)
                file.seek(self._end)
                file.write(self._index)
            raise

    def _type(self, name: str) -> Any:
        return self._store.types[name]

    def _write(self, topic: str, message: Any, frame: Published) -> None:
        kind = message.__msgtype__
        if self._bag.storage is None:
            self._go_on()
        if topic not in self._connections:
            self._connections[topic] = self._bag.add_connection(
                topic, kind, typestore=self._store, offered_qos_profiles=[self._qos]
            )
        raw = self._store.serialize_cdr(message, kind)
        self._bag.write(self._connections[topic], frame.stamp_ns, raw)

    def _header(self, frame: Published, frame_id: str) -> Any:
        seconds, nanoseconds = divmod(frame.stamp_ns, 10**9)
        stamp = self._type("builtin_interfaces/msg/Time")(
            sec=seconds, nanosec=nanoseconds
        )
        return self._type("std_msgs/msg/Header")(stamp=stamp, frame_id=frame_id)

    def _cloud(self, header, table: np.ndarray) -> Any:
        field = self._type("sensor_msgs/msg/PointField")
        names, step = table.dtype.names or (), table.dtype.itemsize
        return self._type("sensor_msgs/msg/PointCloud2")(
            header=header,
            height=1,
            width=len(table),
            fields=[
                field(name=name, offset=4 * i, datatype=FLOAT32, count=1)
                for i, name in enumerate(names)
            ],
            is_bigendian=False,
            point_step=step,
            row_step=step * len(table),
            data=table.view(np.uint8) if len(table) else np.zeros(0, np.uint8),
            is_dense=True,
        )

    def _image(self, header, picture: np.ndarray) -> Any:
        height, width = picture.shape
        return self._type("sensor_msgs/msg/Image")(
            header=header,
            height=height,
            width=width,
            encoding="mono8",
            is_bigendian=0,
            step=width,
            data=np.ascontiguousarray(picture).ravel(),
        )

    def _transform(self, header, child: str, matrix: np.ndarray) -> Any:
        x, y, z, w = Rotation.from_matrix(matrix[:3, :3]).as_quat().tolist()
        forward, left, up = matrix[:3, 3].tolist()
        vector = self._type("geometry_msgs/msg/Vector3")
        quaternion = self._type("geometry_msgs/msg/Quaternion")
        return self._type("geometry_msgs/msg/TransformStamped")(
            header=header,
            child_frame_id=child,
            transform=self._type("geometry_msgs/msg/Transform")(
                translation=vector(x=forward, y=left, z=up),
                rotation=quaternion(x=x, y=y, z=z, w=w),
            ),
        )


def _rosbags(module: str) -> Any:
    need = "a ROS 2 bag needs rosbags"
    return optional(f"rosbags.{module}", need=need, extra="ros")


def _reliable() -> Any:
    """The quality of service that ROS 2 has by default: reliable, keep last 10."""
    kinds = _rosbags("interfaces")
    return kinds.Qos(
        history=kinds.QosHistory.KEEP_LAST,
        depth=10,
        reliability=kinds.QosReliability.RELIABLE,
        durability=kinds.QosDurability.VOLATILE,
        deadline=kinds.QosTime(0, 0),  # none
        lifespan=kinds.QosTime(0, 0),
        liveliness=kinds.QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=kinds.QosTime(0, 0),
        avoid_ros_namespace_conventions=False,
    )
