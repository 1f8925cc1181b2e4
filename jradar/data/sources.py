"""The recordings at a path, and their splits.

ColoRadar's 52 sequences are divided as in the paper (section V-A). The date that begins
their names in the release may be missing.
"""

import difflib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jradar.errors import UsageError
from jradar.files import read_json
from jradar.options.recordings import SPLITS
from jradar.recordings.open import is_recording, open_recording, recordings_in
from jradar.recordings.recording import Recording

APART_S, APART = 2.0, 20  # between the parts of a recording: seconds, frames
TRAIN_RUNS = 3  # "the first three trajectories of each environment"

# date of the recording, environment, number of runs, scene of the paper's Table I
ENVIRONMENTS = (
    ("12_21_2020", "arpg_lab", 5, "Arpg Lab"),
    ("12_21_2020", "ec_hallways", 5, "Hallways"),
    ("2_24_2021", "aspen", 12, "Aspen Lab"),
    ("2_22_2021", "longboard", 8, "Longboard"),
    ("2_28_2021", "outdoors", 10, "Outdoor"),
    ("2_23_2021", "edgar_army", 6, "Edgar Mine"),
    ("2_23_2021", "edgar_classroom", 6, "Edgar Mine"),
)
# Scene and split of each sequence of ColoRadar, by its name.
SEQUENCES = {
    f"{date}_{place}_run{run}": (where, "train" if run < TRAIN_RUNS else "test")
    for date, place, runs, where in ENVIRONMENTS
    for run in range(runs)
}


class Source(NamedTuple):
    """Name, split and path of a recording; any process can open it."""

    name: str
    split: str  # "train", "validation" or "test"
    path: str
    opening: tuple[tuple[str, Any], ...] = ()  # keyword arguments of `open_recording`
    part: tuple[float, float] = (0.0, 1.0)  # of the frames, first and last

    def open(self) -> Recording:
        """Open the recording; its frames are read on access."""
        return open_recording(self.path, **dict(self.opening))

    def frames(self, recording: Recording, chosen: slice) -> range:
        """Return the numbers of the chosen frames that are in this part.

        A part that ends before the last frame ends early, so that the frames of two
        parts are at least `APART_S` apart, or `APART` frames without times.
        """
        count, stamps = len(recording.frames), recording.frames.stamps
        wanted = range(*chosen.indices(count))
        first, last = (round(share * len(wanted)) for share in self.part)
        if last < len(wanted) and stamps is None:
            last = max(last - APART, 0)
        elif last < len(wanted):
            times = np.asarray(stamps)[list(wanted)]  # which may not rise everywhere
            apart = abs(times[:last] - times[last]) > APART_S
            last = int(np.flatnonzero(apart).max(initial=-1)) + 1
        return wanted[first:last]


def find_sources(
    path: Path | str | Sequence[Path | str],
    *,
    splits: Mapping[str, str] | None = None,
    validation_share: float = 0.0,
    **opening: Any,
) -> tuple[Source, ...]:
    """Return the recordings at `path`, or in these folders, by name.

    `opening` are keyword arguments of `open_recording`. The split of a sequence comes
    from `splits` ({name: split}), then from `splits.json` in the folder, then from the
    paper's split for names of ColoRadar, and is "train" otherwise. The last
    `validation_share` of each sequence that trains validates instead, as NAME-end.
    Paths become absolute, because a worker may run in another folder.
    Raises ValueError for two sequences of the same name and for a `splits.json` with
    other splits, and UsageError for `splits` of unknown sequences.
    """
    paths = [path] if isinstance(path, str | Path) else [*path]
    if (description := opening.get("description")) is not None:
        opening["description"] = Path(description).absolute()
    options = tuple((k, v) for k, v in sorted(opening.items()) if v is not None)
    found = [source for p in paths for source in _sources(Path(p).absolute(), options)]
    names = [source.name for source in found]
    if twice := {name for name in names if names.count(name) > 1}:
        raise ValueError(
            f"{', '.join(map(str, paths))}: more than one sequence is named "
            f"{sorted(twice)[0]}: prepare them into different folders"
        )
    wanted = dict(splits or {})
    for name, split in wanted.items():
        if name not in names:
            near = difflib.get_close_matches(name, names, 1) or [", ".join(names)]
            raise UsageError(f"no sequence {name!r} to put into {split}: {near[0]}?")
    if not 0 <= validation_share < 1:
        raise UsageError(f"{validation_share=}, expected 0 to less than 1")
    found = [s._replace(split=wanted.get(s.name, s.split)) for s in found]
    return tuple(part for s in found for part in _parts(s, validation_share))


def _parts(source: Source, share: float) -> tuple[Source, ...]:
    """A sequence, or its first part, which trains, and its last, which validates."""
    if not share or source.split != "train":
        return (source,)
    end = {"name": f"{source.name}-end", "split": "validation"}
    return (
        source._replace(part=(0.0, 1 - share)),
        source._replace(part=(1 - share, 1.0), **end),
    )


def _sources(path: Path, options: Any) -> tuple[Source, ...]:
    """The recording at a path, or those in this folder, by name."""
    found, splits = [path], {}
    if path.is_dir() and not is_recording(path):
        found = sorted(recordings_in(path)) or [path]
    if (listed := path / "splits.json").is_file():
        splits = read_json(listed)
    for name, split in splits.items():
        if split not in SPLITS:
            raise ValueError(
                f"{listed}: {name} is in {json.dumps(split)}, expected one of {SPLITS}"
            )
    names = [p.name if p.is_dir() else p.stem for p in found]
    return tuple(
        Source(name, splits.get(name) or usual_split(name), str(p), options)
        for name, p in zip(names, found, strict=True)
    )


def _of_coloradar(name: str) -> tuple[str, str] | None:
    """Return scene and split of a sequence, None if it is not one of the 52."""
    full = (f"{date}_{name}" for date in {date for date, *_ in ENVIRONMENTS})
    return next((SEQUENCES[n] for n in (name, *full) if n in SEQUENCES), None)


def usual_split(name: str) -> str:
    """Return the paper's split of a sequence of ColoRadar, "train" for other names.

    Runs 0 to 2 of an environment train, later ones test.
    """
    found = _of_coloradar(name)
    return "train" if found is None else found[1]


def scene(name: str) -> str:
    """Return the scene of a sequence as the paper's Table I names it.

    The two mines are one scene. Arpg Lab and Longboard are not in that table. Raises
    ValueError for a name that is not one of the 52.
    """
    if (found := _of_coloradar(name)) is None:
        near = difflib.get_close_matches(name, SEQUENCES, 3) or [*SEQUENCES][:1]
        raise ValueError(
            f"{name!r} is not a sequence of ColoRadar, expected a name such as "
            f"{', '.join(near)}"
        )
    return found[0]
