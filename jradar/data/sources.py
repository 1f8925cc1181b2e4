"""What a path holds: one recording, or a folder of ColoRadar sequences."""

import dataclasses
from pathlib import Path
from typing import Any

from jradar.data.coloradar import is_sequence, split_of
from jradar.data.recording import Recording, open_recording


@dataclasses.dataclass(frozen=True)
class Source:
    """A recording that can be opened in any process."""

    name: str
    split: str  # "train", "validation" or "test"
    path: str
    opening: tuple[tuple[str, Any], ...] = ()  # options of `open_recording`

    def open(self) -> Recording:
        """The recording, whose frames are read when asked for."""
        return open_recording(self.path, **dict(self.opening))
