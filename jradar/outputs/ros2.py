"""ROS 2 bags of frames, in MCAP storage. rosbags encodes messages, without ROS.

/NAME/points          sensor_msgs/PointCloud2: x y z, and velocity, power .. as fields
/radar/range_azimuth  sensor_msgs/Image, mono8
/enhanced/verdict     rcl_interfaces/Log: the expected share of right points, warnings
/tf                   tf2_msgs/TFMessage of radar and LiDAR on the base, and of the
                      base in odom

A bag is a folder with metadata.yaml, which names topics and counts messages.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from jradar.errors import optional
from jradar.outputs.clouds import point_table
from jradar.outputs.messages import MessageWriter, exists
from jradar.outputs.published import RADAR_FRAME, VERDICT, Published
from jradar.recordings.bags.mcap_writer import McapWriter, Schema

FLOAT32 = 7  # of sensor_msgs/PointField
VERSION = 8  # of the bag's metadata, which ROS 2 Humble and later read


class BagWriter(MessageWriter):
    """A bag in MCAP storage; rosbags encodes messages, and describes their topics.

    The storage is our own, because that of rosbags cannot continue once it is complete.
    """

    def __init__(self, path: Path):
        """Create the folder; UsageError if it exists, ImportError without rosbags."""
        rosbag2, typesys = _rosbags("rosbag2"), _rosbags("typesys")
        mcap = rosbag2.StoragePlugin.MCAP

        class Bag(rosbag2.Writer):
            STORAGE_PLUGINS = {mcap: _Storage}

        self._path = path
        self._store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        try:
            self._bag: Any = Bag(path, version=VERSION, storage_plugin=mcap)
            self._bag.open()
        except rosbag2.WriterError:  # created since the caller looked
            raise exists(path) from None
        self._storage: _Storage = self._bag.storage
        self._topics, self._qos = dict[str, Any](), _reliable()

    def _put(self, frame: Published) -> None:
        for topic, message in self._messages(frame):
            kind = message.__msgtype__
            if topic not in self._topics:
                self._topics[topic] = self._bag.add_connection(
                    topic, kind, typestore=self._store, offered_qos_profiles=[self._qos]
                )
            raw = self._store.serialize_cdr(message, kind)
            self._bag.write(self._topics[topic], frame.stamp_ns, raw)

    def _complete(self) -> None:
        try:
            self._bag.close()
        except OSError as error:
            if error.errno is None:  # of McapWriter
                raise
            raise OSError(
                f"{self._path} cannot be written ({error}): is the disk full?"
            ) from error
        self._bag.storage = self._storage

    def _close(self) -> None:
        self._storage.abort()

    def _messages(self, frame: Published) -> Iterator[tuple[str, Any]]:
        header = self._header(frame, RADAR_FRAME)
        for name, cloud in frame.clouds.items():
            yield f"/{name}/points", self._cloud(header, point_table(cloud))
        if frame.picture is not None:
            yield "/radar/range_azimuth", self._image(header, frame.picture)
        if frame.verdict:
            yield VERDICT, self._log(header, frame.verdict)
        if frame.transforms:
            transforms = [
                self._transform(self._header(frame, parent), child, matrix)
                for parent, child, matrix in frame.transforms
            ]
            yield "/tf", self._type("tf2_msgs/msg/TFMessage")(transforms=transforms)

    def _log(self, header, verdict: tuple[str, ...]) -> Any:
        log = self._type("rcl_interfaces/msg/Log")
        return log(
            stamp=header.stamp,
            level=log.WARN if len(verdict) > 1 else log.INFO,
            name="jradar",
            msg="; ".join(verdict),
            file="",
            function="",
            line=0,
        )

    def _type(self, name: str) -> Any:
        return self._store.types[name]

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


class _Storage:
    """One MCAP file, with the methods that `rosbags.rosbag2.Writer` calls."""

    def __init__(self, path: Path, _: Any):
        self.path = path / f"{path.name}.mcap"
        self._file = McapWriter(self.path)

    def add_msgtype(self, connection: Any) -> None:
        """Do nothing: `add_connection` adds the type."""

    def add_connection(self, connection: Any, offered_qos_profiles: str) -> None:
        """Add a topic."""
        metadata = {"offered_qos_profiles": offered_qos_profiles}
        definition = connection.msgdef.data.encode()
        schema = Schema(connection.msgtype, definition, metadata=metadata)
        self._file.add(connection.topic, schema)

    def write(self, connection: Any, timestamp: int, data: bytes | memoryview) -> None:
        """Add a message."""
        self._file.write(connection.topic, timestamp, data)

    def close(self, version: int, metadata: str) -> None:
        """Complete the file; more messages can follow."""
        self._file.complete()

    def abort(self) -> None:
        """Close the file."""
        self._file.close()


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
