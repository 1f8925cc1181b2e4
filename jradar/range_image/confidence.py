"""Confidence that holds: of points with a confidence of 70 %, 70 % are right.

A network's own probabilities are too high where it has not seen the like. Isotonic
regression on frames that it was not trained on turns them into frequencies (Zadrozny &
Elkan 2002): the closest frequencies, in the squared error, that never fall as the
network's confidence rises.

    confidence and truth of points --fit_calibration--> CalibrationSpec
    confidence, CalibrationSpec    --calibrated-------> confidence
"""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.optimize import isotonic_regression

KNOTS = 33
UNSURE = 0.5  # mean confidence of a cloud under which it is not to be trusted


@dataclasses.dataclass(frozen=True)
class CalibrationSpec:
    """Frequencies at equally spaced confidences from 0 to 1, interpolated between."""

    frequencies: tuple[float, ...]

    def __post_init__(self):
        """Refuse frequencies that fall, and those outside 0 to 1."""
        values = np.asarray(self.frequencies)
        fits = len(values) > 1 and values.min() >= 0 and values.max() <= 1
        if not (fits and (np.diff(values) >= 0).all()):
            raise ValueError(
                f"frequencies = {self.frequencies}, expected two or more that rise "
                "from 0 or more to 1 or less"
            )


def fit_calibration(
    confidence: Float[np.ndarray, " point"], right: Bool[np.ndarray, " point"]
) -> CalibrationSpec:
    """Return the calibration of points whose confidence and truth are known.

    A host function. Raises ValueError for confidences outside 0 to 1, or no points.
    """
    confidence = np.asarray(confidence, float)
    if not (len(confidence) and confidence.min() >= 0 and confidence.max() <= 1):
        raise ValueError(
            f"{len(confidence)} confidences, expected one or more between 0 and 1"
        )
    order = np.argsort(confidence, kind="stable")
    steps = np.round(confidence[order] * 1000)
    levels, first, counts = np.unique(steps, return_index=True, return_counts=True)
    share = np.add.reduceat(np.asarray(right, float)[order], first) / counts
    fitted = isotonic_regression(share, weights=counts).x
    knots = np.interp(np.linspace(0, 1, KNOTS), levels / 1000, fitted)
    return CalibrationSpec(tuple(np.clip(knots, 0, 1).round(4).tolist()))


@functools.partial(jax.jit, static_argnames="calibration")
def calibrated(
    confidence: Float[Array, "..."], calibration: CalibrationSpec
) -> Float[Array, "..."]:
    """Return the frequency with which points of this confidence are right."""
    steps = len(calibration.frequencies) - 1
    place = jnp.clip(confidence, 0.0, 1.0) * steps
    below = jnp.minimum(place.astype(jnp.int32), steps - 1)
    values = jnp.asarray(calibration.frequencies, confidence.dtype)
    low, high = values[below], values[below + 1]
    return low + (high - low) * (place - below)
