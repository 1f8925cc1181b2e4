"""MCAP files and a WebSocket server with Foxglove's messages, through foxglove-sdk.

/NAME/points          foxglove.PointCloud: x y z, and velocity, power .. as fields
/radar/range_azimuth  foxglove.RawImage, mono8
/tf                   foxglove.FrameTransforms of radar and LiDAR on the base
"""

import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from jradar.stream.outputs import exists, load, writing
from jradar.stream.views import BASE_FRAME, RADAR_FRAME, View, point_table

FLUSHED_S = 1.0  # by which a crash may shorten a file
BACKLOG = 16  # messages that wait for a slow viewer, some megabytes each
DEFAULT_PORT = 8765


class Topics:
    """The channels of one file or server."""

    def __init__(self, what: str):
        """Raise ImportError if foxglove-sdk is missing."""
        self.foxglove = load("foxglove", "live", what)
        self.messages = load("foxglove.messages", "live", what)
        self.kinds = load("foxglove.channels", "live", what)
        self.context = self.foxglove.Context()
        self._channels: dict[str, Any] = {}

    def log(self, view: View) -> None:
        """Log everything that a view holds."""
        seconds, nanoseconds = divmod(view.stamp_ns, 10**9)
        stamp = self.messages.Timestamp(sec=seconds, nsec=nanoseconds)
        for name, cloud in view.clouds.items():
            message = self._cloud(stamp, point_table(cloud))
            self._log("PointCloudChannel", f"/{name}/points", message, view)
        if view.picture is not None:
            message = self._image(stamp, view.picture)
            self._log("RawImageChannel", "/radar/range_azimuth", message, view)
        if view.base_from:
            transforms = [
                self._transform(stamp, child, matrix)
                for child, matrix in view.base_from.items()
            ]
            message = self.messages.FrameTransforms(transforms=transforms)
            self._log("FrameTransformsChannel", "/tf", message, view)

    def _log(self, kind: str, topic: str, message: Any, view: View) -> None:
        if topic not in self._channels:
            channel = getattr(self.kinds, kind)(topic, context=self.context)
            self._channels[topic] = channel
        self._channels[topic].log(message, log_time=view.stamp_ns)

    def _cloud(self, stamp, table: np.ndarray):
        m, names = self.messages, table.dtype.names or ()
        kind = m.PackedElementFieldNumericType.Float32
        fields = [
            m.PackedElementField(name=name, offset=4 * i, type=kind)
            for i, name in enumerate(names)
        ]
        return m.PointCloud(
            timestamp=stamp,
            frame_id=RADAR_FRAME,
            pose=m.Pose(
                position=m.Vector3(x=0, y=0, z=0),
                orientation=m.Quaternion(x=0, y=0, z=0, w=1),
            ),
            point_stride=table.dtype.itemsize,
            fields=fields,
            data=table.tobytes(),
        )

    def _image(self, stamp, picture: np.ndarray):
        height, width = picture.shape
        return self.messages.RawImage(
            timestamp=stamp,
            frame_id=RADAR_FRAME,
            width=width,
            height=height,
            encoding="mono8",
            step=width,
            data=picture.tobytes(),
        )

    def _transform(self, stamp, child: str, matrix: np.ndarray):
        x, y, z, w = Rotation.from_matrix(matrix[:3, :3]).as_quat().tolist()
        forward, left, up = matrix[:3, 3].tolist()
        return self.messages.FrameTransform(
            timestamp=stamp,
            parent_frame_id=BASE_FRAME,
            child_frame_id=child,
            translation=self.messages.Vector3(x=forward, y=left, z=up),
            rotation=self.messages.Quaternion(x=x, y=y, z=z, w=w),
        )


class McapWriter:
    """One MCAP file."""

    def __init__(self, path: Path):
        """Create the file; UsageError if it exists."""
        self.path, self._topics = path, Topics("an MCAP file")
        context = self._topics.context
        try:
            self._file = self._topics.foxglove.open_mcap(path, context=context)
        except FileExistsError:  # created since the caller looked
            raise exists(path) from None
        self._flushed_s = time.monotonic()

    def write(self, view: View) -> None:
        """Write a view; what is older than a second is safe from a crash.

        Raises OSError if the file cannot be written, such as on a full disk.
        """
        with writing(self.path):
            self._topics.log(view)
            now = time.monotonic()
            if now - self._flushed_s >= FLUSHED_S:
                self._file.flush()
                self._flushed_s = now

    def close(self) -> None:
        """Write the index."""
        with writing(self.path):
            self._file.close()


class Server:
    """A WebSocket server that Foxglove connects to."""

    def __init__(self, *, host: str = "127.0.0.1", port: int = DEFAULT_PORT):
        """Start serving; port 0 takes a free one. OSError if the port is taken."""
        self._topics = Topics("--serve")
        try:
            self._server = self._topics.foxglove.start_server(
                name="jradar",
                host=host,
                port=port,
                context=self._topics.context,
                message_backlog_size=BACKLOG,
            )
        except Exception as error:
            raise OSError(
                f"port {port} of {host} cannot be served on ({error}): is another "
                "program using it? Name another with --serve PORT"
            ) from error
        self.host = host

    @property
    def port(self) -> int:
        """The port it listens on."""
        return self._server.port

    def write(self, view: View) -> None:
        """Send a view to all viewers; those that are too slow miss it."""
        self._topics.log(view)

    def close(self) -> None:
        """Stop serving."""
        self._server.stop()
