"""ROS 2 bags of views, through rosbags; no ROS is needed.

/NAME/points          sensor_msgs/PointCloud2: x y z, and velocity, power .. as fields
/radar/range_azimuth  sensor_msgs/Image, mono8
/tf                   tf2_msgs/TFMessage of radar and LiDAR on the base
"""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from jradar.stream.outputs import load, writing
from jradar.stream.views import BASE_FRAME, RADAR_FRAME, View, point_table

FLOAT32 = 7  # of sensor_msgs/PointField
VERSION = 8  # of the bag's metadata, which ROS 2 Humble and later read


class BagWriter:
    """A bag in SQLite's format, a folder with metadata.yaml."""

    def __init__(self, path: Path):
        """Create the folder; it must not exist. ImportError if rosbags is missing."""
        rosbag2 = load("rosbags.rosbag2", "ros", "a ROS 2 bag")
        typesys = load("rosbags.typesys", "ros", "a ROS 2 bag")
        self._store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        self.path, self._bag = path, rosbag2.Writer(path, version=VERSION)
        self._bag.open()
        self._connections: dict[str, Any] = {}

    def write(self, view: View) -> None:
        """Write all messages of a view; OSError if the disk is full."""
        header = self._header(view, RADAR_FRAME)
        for name, cloud in view.clouds.items():
            message = self._cloud(header, point_table(cloud))
            self._write(f"/{name}/points", message, view)
        if view.picture is not None:
            message = self._image(header, view.picture)
            self._write("/radar/range_azimuth", message, view)
        if view.base_from:
            transforms = [
                self._transform(self._header(view, BASE_FRAME), child, matrix)
                for child, matrix in view.base_from.items()
            ]
            message = self._type("tf2_msgs/msg/TFMessage")(transforms=transforms)
            self._write("/tf", message, view)

    def close(self) -> None:
        """Write the metadata."""
        with writing(self.path):
            self._bag.close()

    def _type(self, name: str) -> Any:
        return self._store.types[name]

    def _write(self, topic: str, message: Any, view: View) -> None:
        kind = message.__msgtype__
        with writing(self.path):
            if topic not in self._connections:
                self._connections[topic] = self._bag.add_connection(
                    topic, kind, typestore=self._store
                )
            raw = self._store.serialize_cdr(message, kind)
            self._bag.write(self._connections[topic], view.stamp_ns, raw)

    def _header(self, view: View, frame_id: str) -> Any:
        seconds, nanoseconds = divmod(view.stamp_ns, 10**9)
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
