"""Scores by distance from the radar: where a cloud is good, and where it is not.

    radar  |  0 to 3 m  |  3 to 6 m  |  ...
precision: found points of a ring that have a true point nearby, in any ring
recall:    true points of a ring that have a found point nearby, in any ring
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from jradar.evaluation.reliability import near_truth

RINGS = 4  # up to the end of the view


def ring_edges(max_range_m: float) -> tuple[float, ...]:
    """Return the distances in metres at which rings of equal width begin and end."""
    return tuple(np.linspace(0.0, max_range_m, RINGS + 1).tolist())


def score_rings(
    found: Float[np.ndarray, "point 3"],
    truth: Float[np.ndarray, "other 3"],
    *,
    edges: Sequence[float],
) -> Iterator[dict[str, Any]]:
    """Yield the F-score at 0.2 m of each ring, with the fields that `summarise` needs.

    It is NaN in a ring without a true point, and 0 in one without a found point.
    """
    right, seen = near_truth(found, truth), near_truth(truth, found)
    distances = [np.linalg.norm(points, axis=-1) for points in (found, truth)]
    for low, high in itertools.pairwise(edges):
        here, there = ((low <= d) & (d < high) for d in distances)
        precision = right[here].mean() if here.any() else 0.0
        recall = seen[there].mean() if there.any() else 0.0
        both = precision + recall
        score = 2 * precision * recall / both if both else 0.0
        yield {
            "distance": f"{low:g} to {high:g} m",
            "points": int(here.sum()),
            "truth_points": int(there.sum()),
            "f_score_0.2": float(score) if there.any() else math.nan,
        }
