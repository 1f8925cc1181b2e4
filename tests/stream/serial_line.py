"""A data port: a pseudo-terminal, to whose other end a board's bytes are written."""

import contextlib
import os
import time

import pytest

from jradar.stream.points_port import PointsPort, points_on_the_cable
from tests.stream.loops import PATIENCE_S


class Line:
    """The end of a serial line at which the board sends."""

    def __init__(self):
        tty = pytest.importorskip("tty")
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self.port, self._slave = os.ttyname(slave), slave

    def send(self, data, *, size=1 << 12, pause_s=0.0):
        """Send bytes in pieces of a size, with pauses in between."""
        for at in range(0, len(data), size):
            left = data[at : at + size]
            while left:
                left = left[os.write(self.master, left) :]
            time.sleep(pause_s)

    def vanish(self):
        """Pull the cable."""
        if self.master is not None:
            os.close(self.master)
            os.close(self._slave)
            self.master = None


@contextlib.contextmanager
def line():
    """A line that ends with the block."""
    pytest.importorskip("serial")
    made = Line()
    try:
        yield made
    finally:
        made.vanish()


@contextlib.contextmanager
def listening(description=None, *, waiting=1000, **options):
    """A line, and the port that listens to it and keeps every frame."""
    with line() as sender:
        radar = points_on_the_cable(sender.port, description, **options)
        with PointsPort(sender.port, radar, waiting=waiting) as port:
            yield sender, port


def taken(port, count):
    """So many frames; none may come after them."""
    frames = []
    while len(frames) < count:
        frame = port.take(PATIENCE_S)
        assert frame is not None, f"{len(frames)} frames came, expected {count}"
        frames.append(frame)
    assert port.take(0.3) is None
    return frames
