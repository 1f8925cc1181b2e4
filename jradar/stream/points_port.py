"""The points that a board sends over its data port, as clouds.

    data port ---bytes--> Parser -> whole packet -> columns -> Layout -> PointCloud

A stream may begin anywhere, and lose bytes anywhere: what belongs to no whole packet is
counted, and the next packet is taken. `recordings.points.ti_stream` parses the bytes,
here and in saved streams.
"""

import re
import time
from pathlib import Path
from typing import Any

from jradar.files import read_text
from jradar.recordings import Recording, Stream, read_description
from jradar.recordings.points.fields import Layout, match_fields
from jradar.recordings.points.ti_stream import (
    DECIBELS,
    FORWARD,
    Packet,
    Parser,
    check_demo,
    no_velocities,
    packet_points,
)
from jradar.stream.board import open_port
from jradar.stream.source import ReceivedFrame, Source

DATA_BAUD = 921_600  # of TI's demos, unless the .cfg says otherwise
USUAL = ("x", "y", "z", "doppler", "snr")  # columns, until points have come
MOST_MISSING = 1000  # frames; a larger step of their numbers is another stream
README = "See jradar/stream/README.md"


def points_on_the_cable(
    port: str, description: Path | str | None = None, *, device: str | None = None
) -> Recording:
    """Return a recording without frames, of a radar that sends points over `port`.

    `description` is its .cfg or another description, and `device` the board of a .cfg;
    without one, `Recording.radar` is None. Errors as in `read_description`.
    """
    points = Stream([].__getitem__, 0)
    if description is None:
        return Recording(name=Path(port).name, path=Path(port), points=points)
    path, found = Path(description), read_description(description, device=device)
    return Recording(
        name=path.stem,
        path=path,
        radar=found.capture.radar(found.radar),
        points=points,
        base_from_radar=found.capture.base_from_radar(),
        notes=found.notes,
    )


def data_rate(description: Path) -> int:
    """Return the baud of the data port: that of a .cfg's `configDataPort`, or TI's.

    Raises ValueError, with the line, for a rate that is not a number.
    """
    rate = DATA_BAUD
    if description.suffix != ".cfg":
        return rate
    for number, line in enumerate(read_text(description).splitlines(), 1):
        command, *fields = re.split("[%#]", line)[0].split() or [""]
        if command != "configDataPort":
            continue
        if not fields or not fields[0].isdigit() or not int(fields[0]):
            raise ValueError(
                f"{description}, line {number}: {line.strip()!r}, expected a rate in "
                f"baud, such as `configDataPort {DATA_BAUD} 0`"
            )
        rate = int(fields[0])
    return rate


class PointsPort(Source):
    """Clouds from a data port, along jradar's axes."""

    def __init__(self, port: str, recording: Recording, *, waiting: int = 1):
        """Open the port; OSError, with the fix, if it cannot be opened.

        `recording` is that of `points_on_the_cable`: its .cfg has the port's rate, and
        its radar the step of velocities of SDK 1 and 2. At most `waiting` frames wait
        to be taken.
        """
        super().__init__(waiting)
        self.port, self.baud = port, data_rate(recording.path)
        self.missing = self.damaged = self.restarts = 0  # frames; starts of the board
        self._step: float | None = None
        if recording.radar is not None:
            self._step = recording.radar.spec.velocity_resolution_mps
        self._parser = Parser()
        self._fields = match_fields(USUAL)
        self._damaged_bytes = self._silent_bytes = 0
        self._last: Packet | None = None
        self._number = -1
        self._serial = open_port(port, self.baud)

    def __enter__(self) -> Source:
        self._read()  # and forget what a board that runs already has sent
        return super().__enter__()

    def close(self) -> None:
        """End the thread, and free the port."""
        super().close()
        self._serial.close()

    @property
    def lost_bytes(self) -> int:
        """Bytes so far that belong to no whole packet."""
        return self._parser.lost_bytes + self._damaged_bytes

    def silence(self, limit_s: float) -> str:
        """Return why no packet may have come for `limit_s`, else ""."""
        silent = time.monotonic() - self.heard_s
        if silent < limit_s:
            return ""
        if self._silent_bytes:
            return (
                f"{self._silent_bytes:,} bytes came from {self.port} within "
                f"{silent:.1f} s, but no packet of TI's points: is {self.baud:,} "
                "baud its rate (configDataPort), is it the data port (the second of "
                "the two), does the board run the SDK's out-of-box demo, and does no "
                f"other program read the port? {README}"
            )
        return (
            f"nothing came from {self.port} for {silent:.1f} s: is it the data port "
            "(the second of the two), was the board started (--board PORT sends it "
            "the .cfg), and does its .cfg send points (guiMonitor -1 1 0 0 0 0 0)? "
            f"{README}"
        )

    def oddity(self) -> str:
        """Return a warning about points without velocities, else ""."""
        last = self._last
        return "" if last is None else "".join(no_velocities(last, self._step))

    def losses(self) -> str:
        """Return the number of bytes that were lost."""
        return f"{self.lost_bytes:,} bytes lost"

    def describe(self) -> dict[str, Any]:
        """Return what happened to bytes and frames."""
        return {
            "frames missing": self.missing,
            "frames damaged": self.damaged,
            "lost bytes": self.lost_bytes,
            "restarts of the board": self.restarts,
        }

    def _listen(self) -> None:
        while not self._ending.is_set():
            if data := self._read(1):
                self._silent_bytes += len(data)
                for packet in self._parser.feed(data, stamp_s=time.time()):
                    self._take(packet)

    def _read(self, least: int = 0) -> bytes:
        """Return the bytes that wait; with `least`, wait a little for so many."""
        try:
            return self._serial.read(max(self._serial.in_waiting, least))
        except OSError as error:
            raise OSError(
                f"{self.port} is gone after {self.received:,} frames ({error}): was "
                "the cable pulled, the board switched off, or does another program "
                "read the port? The output holds the frames until then"
            ) from error

    def _take(self, packet: Packet) -> None:
        """Deliver the points of a packet; ValueError for those of another demo."""
        check_demo(packet)
        self._count(packet)
        try:
            columns = packet_points(packet, velocity_step_mps=self._step)
        except ValueError:  # a TLV's size is not that of points
            self.damaged += 1
            self._damaged_bytes += packet.size
            return
        if len(columns["x"]) or packet.is_old:  # other empty frames show no fields
            self._fields = match_fields(columns)
        cloud = Layout(self._fields, FORWARD, DECIBELS).cloud(columns)
        self.heard_s, self._silent_bytes = time.monotonic(), 0
        stamp_s = time.time() if packet.stamp_s is None else packet.stamp_s
        self._deliver(ReceivedFrame(self._number, cloud, 0, stamp_s, self.heard_s))

    def _count(self, packet: Packet) -> None:
        """Number a packet, with those that are missing before it.

        Sub-frames of one frame have its number, and are frames here.
        """
        step = 1 if self._last is None else packet.frame - self._last.frame
        if step < 0:
            self.restarts += 1
        ahead = step if 1 < step <= MOST_MISSING else 1
        self.missing += ahead - 1
        self._number += ahead
        self._last = packet._replace(parts=())
