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

# environment: date of the recording, number of runs, scene of the paper's Table I
ENVIRONMENTS = {
    "arpg_lab": ("12_21_2020", 5, "Arpg Lab"),
    "ec_hallways": ("12_21_2020", 5, "Hallways"),
    "aspen": ("2_24_2021", 12, "Aspen Lab"),
    "longboard": ("2_22_2021", 8, "Longboard"),
    "outdoors": ("2_28_2021", 10, "Outdoor"),
    "edgar_army": ("2_23_2021", 6, "Edgar Mine"),
    "edgar_classroom": ("2_23_2021", 6, "Edgar Mine"),
}

# The sequences of each environment, in the order of their runs (run10 after run9).
SEQUENCES = {
    place: tuple(f"{date}_{place}_run{run}" for run in range(runs))
    for place, (date, runs, _) in ENVIRONMENTS.items()
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
        Source(name, splits.get(name) or _usual_split(name), str(p), options)
        for name, p in zip(names, found, strict=True)
    )


def _usual_split(name: str) -> str:
    try:
        return paper_split(name)
    except ValueError:  # not a sequence of ColoRadar
        return "train"


def environment(name: str) -> str:
    """Return the environment of a sequence, a key of `SEQUENCES`.

    Raises ValueError for a name that is not one of the 52.
    """
    for place, names in SEQUENCES.items():
        if name in names or f"{ENVIRONMENTS[place][0]}_{name}" in names:
            return place
    known = [full for names in SEQUENCES.values() for full in names]
    near = difflib.get_close_matches(name, known, 3) or known[:1]
    raise ValueError(
        f"{name!r} is not a sequence of ColoRadar, expected a name such as "
        f"{', '.join(near)}"
    )


def scene(name: str) -> str:
    """Return the scene of a sequence as the paper's Table I names it.

    The two mines are one scene. Arpg Lab and Longboard are not in that table.
    """
    return ENVIRONMENTS[environment(name)][2]


def paper_split(name: str) -> str:
    """Return "train" for runs 0 to 2 of an environment and "test" for later runs."""
    environment(name)
    return "train" if int(name.rpartition("run")[2]) < TRAIN_RUNS else "test"
