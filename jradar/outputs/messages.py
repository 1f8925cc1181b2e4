"""Writes frames as messages into one file, which is made whole every second.

    FoxgloveWriter    `foxglove`    out.mcap
    BagWriter         `ros2`        out.ros2

After a crash in between, or on a full disk, the file has no index, and readers scan it.
"""

import abc
import math
import time
from pathlib import Path

from jradar.errors import UsageError
from jradar.outputs.published import Published

SAVED_S = 1.0  # by which a crash may shorten a file


class MessageWriter(abc.ABC):
    """Writes frames; what is older than a second is safe from a crash."""

    _saved_s, _failed = -math.inf, False

    def write(self, frame: Published) -> None:
        """Write a frame.

        Raises OSError that names the file if it cannot be written, such as on a full
        disk. The file then ends with what was safe.
        """
        self._put(frame)
        self.save()

    def save(self) -> None:
        """Complete the file, if that was last done a second ago or longer."""
        if time.monotonic() - self._saved_s >= SAVED_S:
            self._save()

    def close(self) -> None:
        """Complete the file, and close it."""
        try:
            self._save()
        finally:
            self._close()

    def _save(self) -> None:
        if not self._failed:
            self._failed = True  # unless it succeeds
            self._complete()
            self._failed, self._saved_s = False, time.monotonic()

    @abc.abstractmethod
    def _put(self, frame: Published) -> None:
        """Add the messages of a frame."""

    @abc.abstractmethod
    def _complete(self) -> None:
        """Write the index, so that any reader opens the file; more can follow."""

    @abc.abstractmethod
    def _close(self) -> None:
        """Close the file as it is."""


def exists(path: Path) -> UsageError:
    """Return the error for a file or bag that exists."""
    return UsageError(
        f"{path} exists and is not overwritten: name another output, or add --force"
    )
