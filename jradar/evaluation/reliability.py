"""Whether confidence holds: of points with a confidence of 70 %, 70 % should be right.

A point is right if the truth has a point nearby. The reliability of a confidence is the
share of right points in bins of confidence, and its error is the mean distance between
the two (the expected calibration error, Guo et al. 2017). The precision over the
coverage says how many points are right if only the most confident are kept.

    share                        precision
    right |        /             of kept  |--..
          |     /      error 0            |     ' - .
          |  /                            |           ' .
          +---------- confidence          +--------------- share kept

All functions run on the host.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int


class Reliability(NamedTuple):
    """Points in bins of confidence, of equal width, the lowest first.

    Each field is a sum over the points of a bin, so that several can be added.
    """

    points: Int[np.ndarray, " bin"]
    confidence: Float[np.ndarray, " bin"]
    right: Float[np.ndarray, " bin"]

    def means(self) -> tuple[Float[np.ndarray, " bin"], Float[np.ndarray, " bin"]]:
        """Return mean confidence and share of right points; NaN in an empty bin."""
        with np.errstate(invalid="ignore"):  # 0 / 0
            return self.confidence / self.points, self.right / self.points

    def error(self) -> float:
        """Return the mean distance of confidence and share, 0 to 1; 0 without points.

        Each bin weighs as much as it has points.
        """
        gap = np.abs(self.confidence - self.right).sum()
        return float(gap / max(self.points.sum(), 1))


class Coverage(NamedTuple):
    """Shares of points that are kept, the most confident first, and their precision."""

    kept: Float[np.ndarray, " part"]
    precision: Float[np.ndarray, " part"]  # share of right points among the kept


def reliability(
    confidence: Float[np.ndarray, " point"],
    right: Bool[np.ndarray, " point"],
    *,
    bins: int = 10,
) -> Reliability:
    """Return the reliability of points whose confidence and truth are known.

    A confidence on the edge of two bins counts in the upper one, and 1 in the last.
    Raises ValueError for confidences outside 0 to 1, or no points.
    """
    confidence, right = _checked(confidence, right)
    place = np.minimum((confidence * bins).astype(int), bins - 1)
    sums = (np.bincount(place, of, minlength=bins) for of in (confidence, right))
    return Reliability(np.bincount(place, minlength=bins), *sums)


def precision_over_coverage(
    confidence: Float[np.ndarray, " point"],
    right: Bool[np.ndarray, " point"],
    *,
    parts: int = 10,
) -> Coverage:
    """Return the precision of the most confident points, for equal steps of coverage.

    Points of the same confidence are kept in random order; the precision is its mean.
    Raises ValueError for confidences outside 0 to 1, or no points.
    """
    confidence, right = _checked(confidence, right)
    order = np.argsort(-confidence, kind="stable")
    last = np.flatnonzero(np.diff(confidence[order], append=-1.0))  # of equal ones
    number = np.append(0, last + 1)
    hits = np.append(0, np.cumsum(right[order])[last])
    kept = np.arange(1, parts + 1) / parts
    wanted = kept * len(confidence)
    return Coverage(kept, np.interp(wanted, number, hits) / wanted)


def _checked(confidence, right):
    """Return both as arrays. Raises ValueError unless they are of the same points."""
    confidence, right = np.asarray(confidence), np.asarray(right, bool)
    if confidence.shape != right.shape or not len(confidence):
        raise ValueError(
            f"{len(confidence)} confidences of {len(right)} points, expected one of "
            "each point, and one point or more"
        )
    if not (confidence.min() >= 0 and confidence.max() <= 1):  # also NaN
        raise ValueError(
            f"confidences of {confidence.min():g} to {confidence.max():g}, expected "
            "0 to 1"
        )
    return confidence, right
