"""MCAP files with Foxglove's messages, which foxglove-sdk encodes.

/NAME/points          foxglove.PointCloud: x y z, and velocity, power .. as fields
/radar/range_azimuth  foxglove.RawImage, mono8
/enhanced/verdict     foxglove.Log: the expected share of right points, and warnings
/tf                   foxglove.FrameTransforms of radar and LiDAR on the base, and of
                      the base in odom
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from jradar.errors import UsageError, optional
from jradar.outputs.clouds import point_table
from jradar.outputs.messages import MessageWriter, exists
from jradar.outputs.published import CLOUDS, RADAR_FRAME, VERDICT, Published
from jradar.recordings.bags.mcap_writer import McapWriter, Schema

ENCODING = "protobuf"


class FoxgloveMessages:
    """Frames as Foxglove's messages."""

    def __init__(self, what: str):
        """Raise ImportError, which begins with `what`, if foxglove-sdk is missing."""
        need = f"{what} needs foxglove-sdk"
        self.foxglove = optional("foxglove", need=need, extra="live")
        self.messages = optional("foxglove.messages", need=need, extra="live")

    def kinds(self) -> dict[str, Any]:
        """Return the classes of the messages of all topics that jradar publishes."""
        m = self.messages
        clouds = {f"/{name}/points": m.PointCloud for name in CLOUDS}
        others = {"/radar/range_azimuth": m.RawImage, VERDICT: m.Log}
        return {**clouds, **others, "/tf": m.FrameTransforms}

    def of(self, frame: Published) -> Iterator[tuple[str, Any]]:
        """Yield the topic and the message of everything that a frame holds."""
        seconds, nanoseconds = divmod(frame.stamp_ns, 10**9)
        stamp = self.messages.Timestamp(sec=seconds, nsec=nanoseconds)
        for name, cloud in frame.clouds.items():
            yield f"/{name}/points", self._cloud(stamp, point_table(cloud))
        if frame.picture is not None:
            yield "/radar/range_azimuth", self._image(stamp, frame.picture)
        if frame.verdict:
            yield VERDICT, self._log(stamp, frame.verdict)
        if frame.transforms:
            transforms = [
                self._transform(stamp, parent, child, matrix)
                for parent, child, matrix in frame.transforms
            ]
            yield "/tf", self.messages.FrameTransforms(transforms=transforms)

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

    def _log(self, stamp, verdict: tuple[str, ...]):
        levels = self.messages.LogLevel
        return self.messages.Log(
            timestamp=stamp,
            level=levels.Warning if len(verdict) > 1 else levels.Info,
            message="; ".join(verdict),
            name="jradar",
        )

    def _transform(self, stamp, parent: str, child: str, matrix: np.ndarray):
        x, y, z, w = Rotation.from_matrix(matrix[:3, :3]).as_quat().tolist()
        forward, left, up = matrix[:3, 3].tolist()
        return self.messages.FrameTransform(
            timestamp=stamp,
            parent_frame_id=parent,
            child_frame_id=child,
            translation=self.messages.Vector3(x=forward, y=left, z=up),
            rotation=self.messages.Quaternion(x=x, y=y, z=z, w=w),
        )


class FoxgloveWriter(MessageWriter):
    """One MCAP file."""

    def __init__(self, path: Path):
        """Create the file; UsageError if it exists."""
        self._messages = FoxgloveMessages("an MCAP file")
        try:
            self._file = McapWriter(path, profile="", compress=True)
        except UsageError:  # created since the caller looked
            raise exists(path) from None

    def _put(self, frame: Published) -> None:
        for topic, message in self._messages.of(frame):
            if topic not in self._file.topics:
                kind = message.get_schema()
                schema = Schema(kind.name, kind.data, kind.encoding, ENCODING)
                self._file.add(topic, schema)
            self._file.write(topic, frame.stamp_ns, message.encode())

    def _complete(self) -> None:
        self._file.complete()

    def _close(self) -> None:
        self._file.close()
