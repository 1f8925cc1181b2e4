"""What a path holds for preparation: one recording, or a folder of sequences."""

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jradar.data.coloradar_splits import paper_split
from jradar.data.records import read_json
from jradar.recordings.coloradar import is_coloradar
from jradar.recordings.cubes import open_recording
from jradar.recordings.recording import Recording

SPLITS = ("train", "validation", "test")


@dataclasses.dataclass(frozen=True)
class Source:
    """A recording that can be opened in any process that sees its files."""

    name: str
    split: str  # "train", "validation" or "test"
    path: str
    opening: tuple[tuple[str, Any], ...] = ()  # options of `open_recording`

    def open(self) -> Recording:
        """The recording, whose frames are read when asked for."""
        return open_recording(self.path, **dict(self.opening))


def find_sources(path: Path | str, **opening: Any) -> tuple[Source, ...]:
    """The recording at `path`, or all ColoRadar sequences below it, by name.

    A sequence's split is that of a `splits.json` at `path` (name: split), else the
    paper's where the name is one of ColoRadar's, else "train". Raises ValueError where
    two sequences have the same name.
    """
    path = Path(path).absolute()
    options = tuple((k, v) for k, v in sorted(opening.items()) if v is not None)
    found = [path]
    if path.is_dir() and not is_coloradar(path):
        inside = (p for pattern in ("*", "*/*") for p in path.glob(pattern))
        shown = (p for p in inside if not _hidden(p.relative_to(path)))
        found = sorted(p for p in shown if p.is_dir() and is_coloradar(p)) or [path]
    splits = _splits(path / "splits.json" if path.is_dir() else None)
    names = [p.name if p.is_dir() else p.stem for p in found]
    if twice := {name for name in names if names.count(name) > 1}:
        raise ValueError(
            f"{path} holds more than one sequence named {sorted(twice)[0]}: prepare "
            "them apart"
        )
    return tuple(
        Source(name, _split(name, splits), str(p), options)
        for name, p in zip(names, found, strict=True)
    )


def _hidden(path: Path) -> bool:
    """Whether a path leads through a hidden folder: of a run that was killed, say."""
    return any(part.startswith(".") for part in path.parts)


def _splits(path: Path | None) -> Mapping[str, str]:
    """The names and splits of a `splits.json`, empty where there is none."""
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
    """The split of a sequence by its name."""
    if name in splits:
        return splits[name]
    try:
        return paper_split(name)
    except ValueError:
        return "train"
