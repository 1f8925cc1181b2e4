"""ColoRadar's 52 sequences and the paper's split of them (section V-A).

Functions take names with and without the date with which the release starts them.
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

# The sequences of each environment, in the order of their runs (run10 after run9).
SEQUENCES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        place: tuple(f"{date}_{place}_run{run}" for run in range(runs))
        for place, (date, runs, _) in ENVIRONMENTS.items()
    }
)


def environment(name: str) -> str:
    """Return the environment of a sequence, a key of `SEQUENCES`.

    Raises ValueError for a name that is not one of the 52.
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
