"""ColoRadar's 52 sequences, and which of them the paper trains on (section V-A).

Names come with and without the date that the release puts before them.
"""

import difflib
from collections.abc import Mapping
from types import MappingProxyType

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

# Environment: its sequences, the first run first (run10 after run9).
SEQUENCES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        place: tuple(f"{date}_{place}_run{run}" for run in range(runs))
        for place, (date, runs, _) in ENVIRONMENTS.items()
    }
)


def environment(name: str) -> str:
    """The environment of a sequence: a key of `SEQUENCES`.

    Raises ValueError for a name that is none of the 52.
    """
    known = {
        alias: place
        for place, names in SEQUENCES.items()
        for full in names
        for alias in (full, full.removeprefix(f"{ENVIRONMENTS[place][0]}_"))
    }
    if name in known:
        return known[name]
    near = difflib.get_close_matches(name, known, 3) or ["12_21_2020_ec_hallways_run0"]
    raise ValueError(
        f"{name!r} is no sequence of ColoRadar, expected a name such as "
        f"{', '.join(near)}"
    )


def scene(name: str) -> str:
    """The scene under which the paper's Table I counts a sequence: both mines are one.

    Arpg Lab and Longboard are in no row of that table.
    """
    return ENVIRONMENTS[environment(name)][2]


def paper_split(name: str) -> str:
    """Whether the paper trains or tests on a sequence: "train" for runs 0 to 2."""
    environment(name)
    return "train" if int(name.rpartition("run")[2]) < TRAIN_RUNS else "test"
