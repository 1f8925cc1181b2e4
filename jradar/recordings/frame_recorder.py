"""A radar's frames as they come from the cable, as a folder that is a recording.

walk/adc_data.bin    samples of every frame, as the capture card sent them
walk/frames.txt      a line each: arrival of its first packet, lost bytes
walk/radar.toml      the radar, with its calibration
walk/capture.toml    joins them; add the tables [lidar], [poses] and [imu] to it

Each frame is written when it is complete, samples first, so a recording that was killed
holds all frames but the last.
"""

from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from jradar.errors import UsageError
from jradar.files import write_text
from jradar.recordings.bags.radar_frames import BagRecorder
from jradar.recordings.radar_toml import write_radar_toml
from jradar.recordings.recording import Recording
from jradar.recordings.ti.frame import CaptureSpec

DESCRIPTION = """\
# written by jradar record
[radar]
file = "adc_data.bin"
description = "radar.toml"
stamps = "frames.txt"
allow_partial = true
# xyz = [0, 0, 0]              # position on the base, metres
# rpy_degrees = [0, 0, 0]

# [lidar]
# file = "lidar.bag"           # or the folder of `ros2 bag record`
# xyz = [0, 0, 0]
# rpy_degrees = [0, 0, 0]
"""


WRITTEN_BY_OTHERS = (".bag", ".db3", ".ros2", ".bin", ".pcap", ".pcapng", ".toml")


def open_recorder(path: Path | str, radar: Recording) -> "FrameRecorder | BagRecorder":
    """Return the recorder for a name: a file .mcap, or a folder.

    Raises UsageError for other files, and where a recording is already.
    """
    path = Path(path)
    if path.suffix in WRITTEN_BY_OTHERS:
        raise UsageError(
            f"{path}: expected the name of a folder, or of a file .mcap, such as "
            f"{path.stem}.mcap"
        )
    if path.suffix != ".mcap":
        return FrameRecorder(path, radar)
    path.parent.mkdir(parents=True, exist_ok=True)
    return BagRecorder(path, radar)


class FrameRecorder:
    """Writes frames into a folder; a `with` block ends the recording."""

    def __init__(self, path: Path | str, radar: Recording):
        """Begin a recording of `radar`; UsageError if the folder holds anything."""
        self.path, self.frames, self.lost_bytes = Path(path), 0, 0
        self.path.mkdir(parents=True, exist_ok=True)
        if any(self.path.iterdir()):
            raise UsageError(
                f"{path} is not empty, and recordings are never overwritten: name "
                "another folder"
            )
        order = radar.iq_order or CaptureSpec.iq_order
        mount = radar.base_from_radar
        toml = self.path / "radar.toml"
        write_radar_toml(toml, radar.radar, iq_order=order, mount=mount)
        write_text(self.path / "capture.toml", DESCRIPTION)
        self._samples = (self.path / "adc_data.bin").open("wb", buffering=0)
        self._times = (self.path / "frames.txt").open("wb", buffering=0)

    def __enter__(self) -> "FrameRecorder":
        return self

    def __exit__(self, *_) -> None:
        self._samples.close()
        self._times.close()

    def write(
        self, data: UInt8[np.ndarray, " byte"], stamp_s: float, lost_bytes: int = 0
    ) -> None:
        """Append a frame, lost bytes as zeros, with its time in seconds since 1970.

        Raises OSError that names the folder if it does not fit.
        """
        line = f"{stamp_s:.6f} {lost_bytes}\n".encode()
        for file, part in ((self._samples, data.tobytes()), (self._times, line)):
            left = memoryview(part)
            try:
                while left:
                    left = left[file.write(left) or 0 :]
            except OSError as error:
                raise OSError(
                    f"{self.path} cannot be written ({error}): is the disk full?"
                ) from error
        self.frames += 1
        self.lost_bytes += lost_bytes
