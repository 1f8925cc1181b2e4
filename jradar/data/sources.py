"""Find the recordings at a path: one recording, or a folder of recordings."""

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jradar.data.coloradar_splits import paper_split
from jradar.data.records import read_json
from jradar.recordings.open import is_recording, open_recording
from jradar.recordings.recording import Recording

SPLITS = ("train", "validation", "test")


@dataclasses.dataclass(frozen=True)
class Source:
    """Name, split and path of a recording; any process can open it."""

    name: str
    split: str  # "train", "validation" or "test"
    path: str
    opening: tuple[tuple[str, Any], ...] = ()  # keyword arguments of `open_recording`

    def open(self) -> Recording:
        """Open the recording; its frames are read on access."""
        return open_recording(self.path, **dict(self.opening))


def find_sources(path: Path | str, **opening: Any) -> tuple[Source, ...]:
    """Return the recording at `path`, or all recordings in this folder, by name.

    `opening` are keyword arguments of `open_recording`. The split of a sequence comes
    from `splits.json` at `path` ({name: split}), then from the paper's split for names
    of ColoRadar, and is "train" otherwise. Raises ValueError for two sequences of the
    same name and for a `splits.json` with other splits.
    """
    path = Path(path).absolute()
    options = tuple((k, v) for k, v in sorted(opening.items()) if v is not None)
    found = [path]
    if path.is_dir() and not is_recording(path):
        inside = (p for pattern in ("*", "*/*") for p in path.glob(pattern))
        shown = (p for p in inside if not _hidden(p.relative_to(path)))
        found = sorted(p for p in shown if p.is_dir() and is_recording(p)) or [path]
    splits = _splits(path / "splits.json" if path.is_dir() else None)
    names = [p.name if p.is_dir() else p.stem for p in found]
    if twice := {name for name in names if names.count(name) > 1}:
        raise ValueError(
            f"{path} contains more than one sequence named {sorted(twice)[0]}: prepare "
            "them into different folders"
        )
    return tuple(
        Source(name, _split(name, splits), str(p), options)
        for name, p in zip(names, found, strict=True)
    )


def _hidden(path: Path) -> bool:
    """Whether a part of the path is hidden, as folders of killed runs are."""
    return any(part.startswith(".") for part in path.parts)


def _splits(path: Path | None) -> Mapping[str, str]:
    """The names and splits in a `splits.json`; empty if the file is missing."""
    if path is None or not path.is_file():
        return {}
    splits = read_json(path)
    if wrong := [name for name, split in splits.items() if split not in SPLITS]:
        raise ValueError(
            f"{path}: {wrong[0]} is in {json.dumps(splits[wrong[0]])}, expected one of "
            f"{SPLITS}"
        )
    return splits


def _split(name: str, splits: Mapping[str, str]) -> str:
    """The split of a sequence, by its name."""
    if name in splits:
        return splits[name]
    try:
        return paper_split(name)
    except ValueError:
        return "train"
