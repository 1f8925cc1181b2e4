"""Confidence of drawn cells: how often a cell of this value is right.

A cell of RadarHD's Cartesian grid is right if the LiDAR has one within 0.2 m. What an
image says of a pixel, a probability, a share of draws or a nearness, is no such
frequency, least of all in a building that training never saw. `fit_confidence` turns it
into one, on the trajectories on which limits are chosen; the table shows what is left
of that elsewhere.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from experiments.radarhd.cartesian import FULL, to_cartesian, to_points
from experiments.tables import markdown_table
from jradar.evaluation import near_truth, reliability, reliability_error
from jradar.range_image import ConfidenceTable, fit_confidence as fit_table, frequency
from jradar.range_image.confidence import KNOTS

VALUES = np.linspace(0, 1, KNOTS)  # that cells are counted by: a calibration's own
TITLES = ("cells", "value (%)", "confidence (%)", "right (%)", "error (points)")


class Cells(NamedTuple):
    """Drawn cells of an image."""

    value: Float[np.ndarray, " cell"]
    right: Bool[np.ndarray, " cell"]


def drawn_cells(
    image: Float[np.ndarray, "range azimuth"],
    limit: float,
    truth: Float[np.ndarray, "point 3"],
) -> Cells:
    """Return the Cartesian cells whose pixels exceed the limit."""
    grey = np.where(image > limit, np.clip(np.rint(FULL * image), 2, FULL), 0)
    cartesian = to_cartesian(grey.astype(np.uint8))
    found = cartesian > 0
    return Cells(cartesian[found] / FULL, near_truth(to_points(found), truth))


def counted(cells: Cells, limit: float) -> dict[str, list[int]]:
    """Return how many cells above the limit were drawn, and right, by value."""
    above = cells.value > limit
    place = np.rint(cells.value[above] * (len(VALUES) - 1)).astype(int)
    drawn = np.bincount(place, minlength=len(VALUES))
    right = np.bincount(place, cells.right[above], minlength=len(VALUES))
    return {"drawn": drawn.tolist(), "right": right.astype(int).tolist()}


def fit_confidence(rows: list[dict[str, Any]]) -> dict[str, ConfidenceTable]:
    """Return the frequency by value, from counts in rows, by method.

    Without a drawn cell every value is its own frequency.
    """
    methods: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        if "drawn" in row:
            methods.setdefault(row["method"], []).append(row)
    fitted = {}
    for method, mine in methods.items():
        cells = gathered(mine)
        nothing = ConfidenceTable.of((0.0, 1.0))
        fitted[method] = fit_table(*cells) if len(cells.value) else nothing
    return fitted


def gathered(rows: list[dict[str, Any]]) -> Cells:
    """Return the cells of rows, with the nearest of `VALUES`."""
    drawn, right = (
        np.sum([row[name] for row in rows] or [0 * VALUES.astype(int)], axis=0)
        for name in ("drawn", "right")
    )
    both = np.stack([right, drawn - right], -1)  # right ones first, value by value
    return Cells(
        np.repeat(VALUES, drawn),
        np.repeat(np.tile([True, False], len(VALUES)), both.ravel()),
    )


def confidence_table(
    rows: list[dict[str, Any]],
    confidence: dict[str, ConfidenceTable],
    group: Callable[[dict[str, Any]], str],
) -> str:
    """Return a table of how well the confidence holds, by group and method."""
    rows, lines = [row for row in rows if "drawn" in row], []
    for label in dict.fromkeys(map(group, rows)):
        for method, calibration in confidence.items():
            cells = gathered(
                [r for r in rows if r["method"] == method and group(r) == label]
            )
            if not len(cells.value):
                continue
            sure = np.asarray(frequency(cells.value, calibration))
            error = reliability_error(reliability(sure, cells.right))
            shares = [cells.value.mean(), sure.mean(), cells.right.mean(), error]
            texts = [f"{100 * share:.1f}" for share in shares]
            lines.append([label, method, f"{len(cells.value):,}", *texts])
    return markdown_table(["building", "method", *TITLES], lines)
