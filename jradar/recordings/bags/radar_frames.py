"""Frames of a live radar in an MCAP file, which is a complete recording.

    /radar/frames        jradar_msgs/RadarFrame, one for each frame
      header.stamp         arrival of its first packet, on this computer's clock
      header.frame_id      "radar"
      uint32 lost_bytes    number of bytes that never came, and are zeros
      int16[] samples      as the capture card sent them: [chirp][tx][rx][sample], with
                           I and Q in the order of the description
    /radar/description   std_msgs/String: the radar's TOML (`radar_toml`), with its
                         calibration and its place on the rig, if they are known; before
                         the first two frames and every 1,000, so that one is whole

The file holds the definitions of both types, so any reader of MCAP decodes it. The time
of recording is the stamp, or a nanosecond after the frame before if the clock jumps
back.
"""

import struct
import tomllib
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from jradar.errors import UsageError, parsing
from jradar.files import MAX_TEXT_BYTES
from jradar.recordings.bags.bags import bag_topics, is_bag, messages
from jradar.recordings.bags.mcap_writer import McapWriter, Schema
from jradar.recordings.bags.messages import NS, after_header
from jradar.recordings.descriptions import Description
from jradar.recordings.radar_toml import radar_of_tables, radar_toml
from jradar.recordings.recording import Recording
from jradar.recordings.ti.frame import CaptureSpec

FRAMES, DESCRIPTION = "/radar/frames", "/radar/description"
KIND, TEXT = "jradar_msgs/msg/RadarFrame", "std_msgs/msg/String"
LINE = 80 * "="
DEFINITION = f"""\
std_msgs/Header header
uint32 lost_bytes
int16[] samples
{LINE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{LINE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
LITTLE_ENDIAN = b"\0\1\0\0"  # of CDR
DESCRIBED = 1000  # frames from one description to the next
FRAME_ID = b"radar\0\0\0"  # with its padding


class BagRecorder:
    """Writes frames into an MCAP file; a `with` block ends the recording."""

    def __init__(self, path: Path | str, radar: Recording):
        """Begin a recording of `radar`; UsageError if the file exists."""
        self.path, self.frames, self.lost_bytes = Path(path), 0, 0
        self._radar, self._time_ns = radar, 0
        self._file = McapWriter(self.path)
        self._file.add(DESCRIPTION, Schema(TEXT, b"string data\n"))
        self._file.add(FRAMES, Schema(KIND, DEFINITION.encode()))

    def __enter__(self) -> "BagRecorder":
        return self

    def __exit__(self, *_) -> None:
        self._file.close()

    def write(
        self, data: UInt8[np.ndarray, " byte"], stamp_s: float, lost_bytes: int = 0
    ) -> None:
        """Append a frame, lost bytes as zeros, with its time in seconds since 1970."""
        stamp = round(stamp_s * NS)
        if not self.frames:
            self._time_ns = stamp - 1
        if self.frames == 1 or self.frames % DESCRIBED == 0:
            self._file.write(DESCRIPTION, self._time_ns, self._description())
            self._file.flush()  # so that no chunk holds two
        self._time_ns = max(self._time_ns + 1, stamp)
        seconds, nanoseconds = divmod(stamp, NS)
        head = struct.pack(
            "<iII", seconds, nanoseconds, len(FRAME_ID.rstrip(b"\0")) + 1
        )
        counts = struct.pack("<II", lost_bytes, data.nbytes // 2)
        message = b"".join((LITTLE_ENDIAN, head, FRAME_ID, counts, data.data))
        self._file.write(FRAMES, self._time_ns, message)
        self._file.flush()
        self.frames += 1
        self.lost_bytes += lost_bytes

    def _description(self) -> bytes:
        order = self._radar.iq_order or CaptureSpec.iq_order
        mount = self._radar.base_from_radar
        toml = radar_toml(self._radar.radar, iq_order=order, mount=mount)
        text = toml.encode() + b"\0"
        return LITTLE_ENDIAN + struct.pack("<I", len(text)) + text


def describes_its_radar(path: Path | str) -> bool:
    """True if a bag holds frames and the description of their radar."""
    path = Path(path)
    if not is_bag(path):
        return False
    try:
        kinds = [(name, kind) for name, (kind, _) in bag_topics(path).items()]
    except (ImportError, OSError, ValueError):
        return False
    return (DESCRIPTION, TEXT) in kinds and any(kind == KIND for _, kind in kinds)


def described_radar(path: Path) -> Description:
    """Return the radar that a bag describes; ValueError for a damaged description."""
    raw = next((raw for *_, raw in messages(path, DESCRIPTION)), b"")
    start = 0 if path.suffix == ".bag" else len(LITTLE_ENDIAN)
    source = f"{path}, {DESCRIPTION}"
    with parsing(source, "the description of a radar"):
        (size,) = struct.unpack_from("<I", raw, start)
        text = raw[start + 4 : start + 4 + min(size, MAX_TEXT_BYTES)]
        tables = tomllib.loads(text.rstrip(b"\0").decode())
    try:
        return Description(*radar_of_tables(source, tables))
    except UsageError as error:  # not caused by an option of the user
        raise ValueError(str(error)) from error


def lost_bytes(raw: bytes, *, is_ros1: bool) -> int:
    """Return the bytes that a frame lost; 0 for a message that was cut off."""
    try:
        order, start = after_header(raw, is_ros1, alignment=4)
        (lost,) = struct.unpack_from(f"{order}I", raw, start)
    except struct.error:
        return 0
    return lost
