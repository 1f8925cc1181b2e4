"""Confidence that falls where an answer contradicts the one to the mirror image.

A radar that looks ahead does not know left from right. A network that knows a place
draws the mirrored place when it is given the mirror image. One that guesses draws two
different places. How different they are is the disagreement:

    d = sum |straight - mirrored| / sum (straight + mirrored)

It is 0 if both answers are the same, and 1 if they have no pixel in common. Confidence
falls with it, by a scaling of the log-odds of the confidence table (Platt 1999):

    log-odds = offset + scale * log-odds of the table

Offset and scale are linear in d. They are fitted to images of places that the training
did not see.

    values and truth of pixels, d --fit_scaling--> Scaling
    frequency, d, Scaling         --scaled------> confidence

Which pixels become points depends on how sure the answer is as a whole. Of confidences
c_1 >= c_2 >= ..., the first k have an expected F-score of about

    F_k = 2 * (c_1 + ... + c_k) / (k + sum c)

whose maximum is reached where c falls to half of it (Lipton et al. 2014). A model keeps
the pixels of at least some share of that maximum.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy  # loads `optimize` when it is first used
from jaxtyping import Array, Bool, Float

LEAST_ODDS = 0.001  # a frequency nearer to 0 or 1 counts as this near
BINS = 64  # of frequencies in a fit
STEPS = 128  # of confidence in an expected F-score
FAINT = 0.05  # confidence of pixels that count as empty there


class Scaling(NamedTuple):
    """Offset and scale of log-odds: each without disagreement, and what d = 1 adds."""

    offset: Float[Array | np.ndarray, "2"]
    scale: Float[Array | np.ndarray, "2"]

    @classmethod
    def of(cls, offset: Any, scale: Any) -> "Scaling":
        """Return the scaling; ValueError unless both have two finite numbers."""
        found = cls(*(np.asarray(values, np.float32) for values in (offset, scale)))
        for name, values in found._asdict().items():
            if values.shape != (2,) or not np.isfinite(values).all():
                raise ValueError(f"{name} = {values}, expected two finite numbers")
        return found


class Pixels(NamedTuple):
    """Pixels of one image: frequencies of a table, truth, and its disagreement."""

    frequency: Float[np.ndarray, " pixel"]
    right: Bool[np.ndarray, " pixel"]
    disagreement: float


def disagreement(
    straight: Float[Array, "*batch range azimuth"],
    mirrored: Float[Array, "*batch range azimuth"],
) -> Float[Array, "*batch"]:
    """Return how much two answers of values from 0 up contradict each other, 0 to 1.

    `mirrored` is the answer to the mirror image, mirrored back. Images of zeros agree.
    """
    apart = jnp.abs(straight - mirrored).sum((-2, -1))
    both = (straight + mirrored).sum((-2, -1))
    return apart / jnp.maximum(both, jnp.finfo(both.dtype).tiny)


def scaled(
    frequency: Float[Array, "..."],
    disagreement: Float[Array, ""] | float,
    scaling: Scaling,
) -> Float[Array, "..."]:
    """Return the confidence of pixels of one image; a scale below 0 counts as 0."""
    offset, scale = (a + b * disagreement for a, b in scaling)
    odds = jnp.clip(frequency, LEAST_ODDS, 1 - LEAST_ODDS)
    confidence = jax.nn.sigmoid(
        offset + jnp.maximum(scale, 0.0) * jax.scipy.special.logit(odds)
    )
    return jnp.where(frequency > 0, confidence, 0.0)


@jax.jit
def expected_f_score(
    confidence: Float[Array, "*shape"],
) -> Float[Array, ""]:
    """Return the largest expected F-score of the confident pixels of one image.

    It is 0 for an image without pixels of a confidence of 0.05 or more.
    """
    sure = jnp.where(confidence >= FAINT, confidence, 0.0).ravel()
    step = jnp.clip(jnp.floor(sure * STEPS).astype(int), 0, STEPS - 1)
    none = jnp.zeros(STEPS, sure.dtype)
    count = none.at[step].add(jnp.where(sure > 0, 1.0, 0.0))
    hits = jnp.cumsum(none.at[step].add(sure)[::-1])
    score = 2 * hits / jnp.maximum(jnp.cumsum(count[::-1]) + hits[-1], 1.0)
    return score.max()


def least_confidence(
    confidence: Float[Array, "*shape"], share: float | Float[Array, ""]
) -> Float[Array, ""]:
    """Return a share of the expected F-score of one image, but at least 0.05."""
    return jnp.maximum(share * expected_f_score(confidence), FAINT)


def fit_scaling(images: Sequence[Pixels]) -> Scaling:
    """Return the scaling of greatest likelihood. Every image has the same weight.

    A host function. Raises ValueError without an image that has pixels.
    """
    parts = [part for part in images if len(part.right)]
    if not parts:
        raise ValueError("no pixels, expected one or more images that have some")
    features, right, weights = map(
        np.concatenate, zip(*map(_binned, parts), strict=True)
    )

    def loss(q):
        odds = features @ q
        share = scipy.special.expit(odds)
        likelihood = np.logaddexp(0, odds) - right * odds
        slope = features.T @ (weights * (share - right))
        return weights @ likelihood, slope

    start = np.array([0.0, 0.0, 1.0, 0.0])
    found = scipy.optimize.minimize(loss, start, jac=True, method="BFGS").x
    return Scaling.of(found[:2].round(4), found[2:].round(4))


def _binned(image: Pixels):
    """Return features, shares of right pixels and weights for bins of frequencies."""
    clipped = np.clip(image.frequency, LEAST_ODDS, 1 - LEAST_ODDS)
    place = np.minimum((clipped * BINS).astype(int), BINS - 1)
    count = np.bincount(place, minlength=BINS)
    used = count > 0
    means, share = (
        np.bincount(place, values, minlength=BINS)[used] / count[used]
        for values in (clipped, image.right.astype(float))
    )
    odds = scipy.special.logit(means)
    one, d = np.ones_like(odds), np.full_like(odds, image.disagreement)
    return np.stack([one, d, odds, odds * d], -1), share, count[used] / len(place)
