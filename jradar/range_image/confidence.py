"""Confidence that holds: of points with a confidence of 70 %, 70 % are right.

A network's own probabilities are too high in places unlike its training. Isotonic
regression on frames that it was not trained on turns them into frequencies (Zadrozny &
Elkan 2002): of all frequencies that never fall as the network's confidence rises, those
with the least squared error.

    confidence and truth of points --fit_confidence--> ConfidenceTable
    confidence, ConfidenceTable    --frequency-------> confidence
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy  # loads `optimize` when it is first used
from jaxtyping import Array, Bool, Float

from jradar.compiled import jit

KNOTS = 33
LEAST = 0.375  # of a table that was not fitted
UNSURE = 0.5  # mean confidence below which a cloud is not to be trusted


class ConfidenceTable(NamedTuple):
    """Frequencies at equally spaced confidences from 0 to 1, interpolated between.

    Points with a frequency below `least` are dropped, and so are points below
    `least_alone` that are not near an echo (`near_echo`).
    """

    frequencies: Float[Array | np.ndarray, " knot"]
    least: Float[Array | np.ndarray, ""]
    least_alone: Float[Array | np.ndarray, ""]

    @classmethod
    def of(
        cls,
        frequencies: Any,
        *,
        least: float = LEAST,
        least_alone: float | None = None,
    ) -> "ConfidenceTable":
        """Return the table, or raise ValueError for one that is not a confidence.

        By default, `least_alone` is `least`.
        """
        values = np.asarray(frequencies, np.float32)
        fits = values.ndim == 1 and len(values) > 1
        fits = fits and values.min() >= 0 and values.max() <= 1
        if not (fits and (np.diff(values) >= 0).all()):
            raise ValueError(
                f"frequencies = {frequencies}, expected two or more that rise from 0 "
                "or more to 1 or less"
            )
        alone = least if least_alone is None else least_alone
        for name, value in (("least", least), ("least_alone", alone)):
            if not 0 <= value <= 1:
                raise ValueError(f"{name} = {value}, expected 0 to 1")
        return cls(values, *(np.asarray(v, np.float32) for v in (least, alone)))


IDENTITY = ConfidenceTable.of(np.linspace(0, 1, KNOTS))


def fit_confidence(
    confidence: Float[np.ndarray, " point"],
    right: Bool[np.ndarray, " point"],
    *,
    weights: Float[np.ndarray, " point"] | None = None,
) -> ConfidenceTable:
    """Return the table of points whose confidence and truth are known.

    A host function. Raises ValueError for confidences outside 0 to 1, or no points.
    """
    confidence = np.asarray(confidence, float)
    weights = np.ones(len(confidence)) if weights is None else np.asarray(weights)
    if not (len(confidence) and confidence.min() >= 0 and confidence.max() <= 1):
        raise ValueError(
            f"{len(confidence)} confidences, expected one or more between 0 and 1"
        )
    order = np.argsort(confidence, kind="stable")
    steps = np.round(confidence[order] * 1000)
    levels, first = np.unique(steps, return_index=True)
    weight, share = (
        np.add.reduceat(values[order], first) for values in (weights, weights * right)
    )
    fitted = scipy.optimize.isotonic_regression(share / weight, weights=weight).x
    knots = np.interp(np.linspace(0, 1, KNOTS), levels / 1000, fitted)
    return ConfidenceTable.of(np.clip(knots, 0, 1).round(4))


@jit
def frequency(
    confidence: Float[Array, "..."], table: ConfidenceTable
) -> Float[Array, "..."]:
    """Return the frequency with which points of this confidence are right."""
    steps = table.frequencies.shape[0] - 1
    place = jnp.clip(confidence, 0.0, 1.0) * steps
    below = jnp.minimum(place.astype(jnp.int32), steps - 1)
    values = jnp.asarray(table.frequencies, confidence.dtype)
    low, high = values[below], values[below + 1]
    return low + (high - low) * (place - below)
