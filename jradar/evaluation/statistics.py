"""Means over frames that are not independent, and their comparison.

The variance of a mean is the sum of the autocovariance over all pairs of frames. The
sum stops at the lag beyond which noise dominates (the initial positive sequence of
Geyer 1992). Autocovariance is computed within each sequence, around the mean of all
sequences, and summed over sequences: if sequences differ more than their frames do,
they become the independent units.

Deviations from a sample's own mean are too small. If the sum holds the fraction `share`
of all pairs, its expectation is `1 - share` of the true variance. That factor is
divided out, and the estimate has about `1 / share` degrees of freedom, so an interval
from few correlation lengths is wide. Two or three lengths have no interval: it would
span nearly everything.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import correlate
from scipy.stats import t as student

CONFIDENCE = 0.95  # of an interval
LEAST_FREEDOM = 3  # of an interval: four independent frames
Series = Sequence[Sequence[float | int] | np.ndarray]


class Estimate(NamedTuple):
    """A mean and its confidence interval."""

    mean: float
    low: float
    high: float
    frames: int  # finite values
    effective: float  # independent frames that would give it; too few for any: below 4


class Comparison(NamedTuple):
    """First minus second, frame by frame."""

    difference: Estimate  # of the frames with a score from both
    t_test: float  # p-value of no difference, from the interval's t; NaN without one


def mean_interval(sequences: Series, *, most: float | None = None) -> Estimate:
    """Return the mean over all frames, without NaN, and its 95 % interval.

    Each sequence is in order of time. Values from 0 to `most`, which may be infinite,
    have an interval that stays there: it is symmetric in the log-odds, or in the
    logarithm. The interval is NaN for fewer than `LEAST_FREEDOM` degrees of freedom.
    """
    mean, variance, freedom, frames, effective = _analyse(_arrays(sequences))
    if not freedom >= LEAST_FREEDOM:  # which is NaN for fewer than two values
        effective = float(np.fmin(effective, freedom + 1))
        return Estimate(float(mean), np.nan, np.nan, frames, effective)
    half = student.ppf((1 + CONFIDENCE) / 2, freedom) * np.sqrt(variance)
    ends = mean + half * np.array([-1, 1])
    if most is not None and variance:
        share = mean / most
        factor = np.exp((ends - mean) / mean / (1 - share))
        ends = mean * factor / (1 - share + share * factor)
    low, high = map(float, ends)
    return Estimate(float(mean), low, high, frames, effective)


def compare_paired(first: Series, second: Series) -> Comparison:
    """Return the mean difference of two methods on the same frames, with a t-test.

    The test uses the interval of the mean difference. Tests that take frames as
    independent, such as Wilcoxon's, would report chance as a difference. Frames where
    one of the two is NaN are left out.
    """
    first, second = _arrays(first), _arrays(second)
    lengths = [[len(series) for series in both] for both in (first, second)]
    if lengths[0] != lengths[1]:
        raise ValueError(f"sequences of {lengths[0]} and of {lengths[1]} frames")
    differences = [a - b for a, b in zip(first, second, strict=True)]
    mean, variance, freedom, *_ = _analyse(differences)
    statistic = np.inf if variance == 0 else abs(mean) / np.sqrt(variance)
    t_test = 1.0 if mean == 0 else float(2 * student.sf(statistic, freedom))
    known = freedom >= LEAST_FREEDOM
    return Comparison(mean_interval(differences), t_test if known else np.nan)


def compare_methods(
    first: Sequence[dict[str, Any]], second: Sequence[dict[str, Any]], *, score: str
) -> Comparison:
    """Return `compare_paired` of the rows of two methods.

    Frames are matched by scene, sequence and frame. A frame that only one method scored
    is left out.
    """
    by_frame = []
    for rows in (first, second):
        for field in ("method", "truth"):
            names = sorted({row[field] for row in rows})
            if len(names) != 1:
                raise ValueError(f"rows of the {field}s {names}, expected one {field}")
        by_frame.append({_place(row): row[score] for row in rows})
    series: list[dict[tuple, list[float]]] = [{}, {}]
    for place in sorted(by_frame[0] | by_frame[1]):
        for scores, grouped in zip(by_frame, series, strict=True):
            grouped.setdefault(place[:-1], []).append(scores.get(place, np.nan))
    if not by_frame[0].keys() & by_frame[1].keys():
        raise ValueError(
            "the methods have no frame in common: evaluate them on one split"
        )
    return compare_paired([*series[0].values()], [*series[1].values()])


def _place(row):
    return row["scene"], row["sequence"], row["frame"]


def _arrays(sequences):
    return [np.asarray(series, np.float64) for series in sequences]


def _analyse(sequences):
    """Mean, its variance, degrees of freedom, frames, and effective ones."""
    values = np.concatenate([*sequences, np.zeros(0)])
    known = np.isfinite(values)
    count = int(known.sum())
    mean = values[known].mean() if count else np.nan
    if count and np.ptp(values[known]) == 0:
        mean = values[known][0]  # exact, so that a constant has a variance of 0
    if count < 2:
        return mean, np.nan, np.nan, count, float(count)
    products, pairs = _autocovariance(sequences, mean)
    share = (2 * np.cumsum(pairs) - pairs[0]) / count**2
    lag = min(_positive_lags(products), np.searchsorted(share, 0.5 + 1e-9) - 1)
    share = share[lag]
    variance = (2 * products[: lag + 1].sum() - products[0]) / count**2 / (1 - share)
    independent = (products[0] / count + max(variance, 0)) / count
    variance = max(variance, independent)
    effective = count * independent / variance if variance else float(count)
    return mean, variance, 1 / share - 1, count, float(effective)


def _autocovariance(sequences, mean):
    """Return the sums of products of deviations and the numbers of pairs, by lag."""
    length = max(map(len, sequences))
    products, pairs = np.zeros(length), np.zeros(length)
    for series in sequences:
        if len(series):
            known = np.isfinite(series)
            deviation = np.where(known, series - mean, 0.0)
            lags = slice(len(series) - 1, None)
            products[: len(series)] += correlate(deviation, deviation)[lags]
            known = known.astype(float)
            pairs[: len(series)] += np.rint(correlate(known, known)[lags])
    return products, pairs


def _positive_lags(products):
    """The last lag before noise: before a sum of lags 2k and 2k + 1 is <= 0."""
    even = np.append(products, np.zeros(len(products) % 2)).reshape(-1, 2).sum(1)
    first = np.flatnonzero(even <= 0)
    return max(2 * int(first[0] if len(first) else len(even)) - 1, 0)


def spread(total: int, count: int) -> list[int]:
    """Return at most `count` indices, evenly spread over `total` items."""
    return np.linspace(0, total - 1, min(count, total)).astype(int).tolist()
