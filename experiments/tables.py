"""What the tables of tasks and studies share."""

from collections.abc import Iterable

import numpy as np


def known_mean(values: Iterable[float]) -> float:
    """Return the mean of the values that are not NaN, or NaN if there is none."""
    known = [value for value in values if not np.isnan(value)]
    return float(np.mean(known)) if known else np.nan


def markdown_table(titles: list[str], rows: list[list[str]]) -> str:
    """Return a Markdown table."""
    lines = [titles, ["---"] * len(titles), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)
