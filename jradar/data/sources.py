"""The recordings at a path, and their splits.

ColoRadar's 52 sequences are divided as in the paper (section V-A). Their names are
taken with and without the date with which the release starts them.
"""

import dataclasses
import difflib
import json
from pathlib import Path
from typing import Any

from jradar.files import read_json
from jradar.recordings.open import is_recording, open_recording
from jradar.recordings.recording import Recording

SPLITS = ("train", "validation", "test")
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
    found, splits = [path], {}
    if path.is_dir() and not is_recording(path):
        inside = (p for pattern in ("*", "*/*") for p in path.glob(pattern))
        # Folders of killed runs are hidden.
        shown = (p for p in inside if "/." not in f"/{p.relative_to(path)}")
        found = sorted(p for p in shown if p.is_dir() and is_recording(p)) or [path]
    if (listed := path / "splits.json").is_file():
        splits = read_json(listed)
    for name, split in splits.items():
        if split not in SPLITS:
            raise ValueError(
                f"{listed}: {name} is in {json.dumps(split)}, expected one of {SPLITS}"
            )
    names = [p.name if p.is_dir() else p.stem for p in found]
    if twice := {name for name in names if names.count(name) > 1}:
        raise ValueError(
            f"{path} contains more than one sequence named {sorted(twice)[0]}: prepare "
            "them into different folders"
        )
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
