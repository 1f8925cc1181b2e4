"""Frames as messages in one file, which is complete once a second.

    foxglove   FoxgloveMessages     out.mcap
    ros2       Ros2Messages         out.ros2

Between two seconds a crash leaves a file without its index, which readers scan.
"""

import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol

from jradar.errors import UsageError
from jradar.outputs.published import Published

SAVED_S = 1.0  # by which a crash may shorten a file


class Messages(Protocol):
    """Makes messages of frames, and the file that takes them."""

    def of(self, frame: Published) -> Iterator[tuple[str, Any]]:
        """Yield the topic and the message of everything that a frame holds."""
        ...

    def create(self, path: Path) -> "MessageFile":
        """Create the file; UsageError if it exists."""
        ...


class MessageFile(Protocol):
    """A file or a bag of messages; errors are OSErrors that name it."""

    def put(self, topic: str, message: Any, time_ns: int) -> None:
        """Add a message."""

    def complete(self) -> None:
        """Write the index, so that any reader opens it; it takes more after that."""

    def close(self) -> None:
        """Close it; `complete` comes before."""


class MessageWriter:
    """Writes frames as messages; what is older than a second is safe from a crash."""

    def __init__(self, messages: Messages, path: Path):
        """Create the file; UsageError if it exists."""
        self._messages, self._file = messages, messages.create(path)
        self._saved_s, self._failed = -math.inf, False

    def write(self, frame: Published) -> None:
        """Write a frame.

        Raises OSError if the file cannot be written, such as on a full disk. It then
        holds what was safe, and takes nothing more.
        """
        for topic, message in self._messages.of(frame):
            self._file.put(topic, message, frame.stamp_ns)
        self.save()

    def save(self) -> None:
        """Complete the file, once a second."""
        if time.monotonic() - self._saved_s >= SAVED_S:
            self._complete()

    def close(self) -> None:
        """Complete the file, and close it."""
        try:
            self._complete()
        finally:
            self._file.close()

    def _complete(self) -> None:
        if not self._failed:
            self._failed = True  # unless it succeeds
            self._file.complete()
            self._failed, self._saved_s = False, time.monotonic()


def exists(path: Path) -> UsageError:
    """Return the error for a file or bag that exists."""
    return UsageError(
        f"{path} exists and is not overwritten: name another output, or add --force"
    )
