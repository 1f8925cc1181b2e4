"""How a model draws its answer: the options of `jradar.draw` and of its callers.

`jradar.enhance`, `enhance_points`, `enhance_recording`, `live` and `export` take them
as keyword arguments, and the command line as the flags below.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple, TypedDict


class Drawing(TypedDict, total=False):
    """Options of `draw`; one that is left out, or None, takes the model's default."""

    draws: int | None  # samples of a diffusion model; 8 by default
    steps: int | None  # of each sample; 5 for several, 18 for one
    solver: Any  # a `jradar.diffusion.Solver`; iPNDM for several
    temperature: Any  # of the noise that a sample starts from; the model's, or 1
    least_confidence: Any  # pixels of less are dropped; the model's


STATIC = ("draws", "steps", "solver")  # those that shape the computation


class Flag(NamedTuple):
    """An option on the command line: a count up to `most`, or a share if it is None."""

    flag: str
    help: str
    most: int | None = None


FLAGS = {
    "draws": Flag(
        "--draws",
        "draw N samples and keep the points on which they agree; the paper draws 1 "
        "(default: 8; live: 1)",
        64,
    ),
    "steps": Flag(
        "--steps",
        "solver steps per draw (default: 5 for several draws, 18 for one; live: 1); "
        "one draw takes Heun's method, or iPNDM below 8 steps",
        1000,
    ),
    "least_confidence": Flag(
        "--min-confidence",
        "leave out points of less confidence, 0 to 1 (default: the model's)",
    ),
}


def given(drawing: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options that are not None."""
    return {name: value for name, value in drawing.items() if value is not None}
