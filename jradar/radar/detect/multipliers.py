"""Exact false-alarm multipliers of CFAR detectors, on the host in float64.

A cell X and its noise estimate Z are independent. X is Gamma(M, 1) after summing the
power of M channels. A detector that tests X > alpha Z has the false-alarm rate

    P(alpha) = integral of Q(M, alpha z) dF_Z(z)

with Q the regularised upper incomplete gamma function. With P the lower one, F_Z is

    CA   P(N M, N z)                        mean of N cells
    GO   P(n1 M, n1 z) P(n2 M, n2 z)        greater of the means of n1 and n2 cells
    SO   1 - Q(n1 M, n1 z) Q(n2 M, n2 z)    smaller of the two means
    OS   I_{P(M, z)}(k, N - k + 1)          k-th smallest of N cells

One numerical integral serves all kinds (Gandhi & Kassam 1988; Rohling 1983). For M = 1
it agrees with the closed forms.
"""

import functools
import math
from typing import Any

import numpy as np
import scipy  # loads `optimize` and `special` when they are first used

from jradar.options.detectors import KINDS

Number = int | float  # fractions stand for correlated cells, see `correlation`
TAIL = 1e-18  # probability omitted at either end of the integral


@functools.cache
def false_alarm_multiplier(
    kind: str,
    rate: float,
    cells: Number | tuple[Number, Number],
    *,
    rank: Number | None = None,
    channels: int = 1,
) -> float:
    """Return the factor on a noise estimate from `cells` cells that yields the rate.

    `kind` is one of `KINDS`; `rank`, for "os", counts from 1. For "go" and "so" `cells`
    may be the sizes of the two halves; if one half is empty, the mean of the other one
    counts. Raises ValueError for an unknown kind and for numbers out of range.
    """
    if kind not in KINDS:
        raise ValueError(f"CFAR kind {kind!r}, expected one of {tuple(KINDS)}")
    if not 0 < rate <= 1:
        raise ValueError(f"false_alarm_rate = {rate}, expected 0 < rate <= 1")
    halves = cells if isinstance(cells, tuple) else (cells // 2, cells - cells // 2)
    total = sum(halves)
    if min(halves) < 0 or total < 1 or channels < 1:
        raise ValueError(f"CFAR {cells=}, {channels=}: expected 1 or more")
    if kind == "os" and not (rank and 1 <= rank <= total):
        raise ValueError(f"OS-CFAR {rank=}, expected 1 to {total}")
    if rate == 1:
        return 0.0
    if kind == "ca" or (kind in ("go", "so") and 0 in halves):
        z, weight = _mean_density(total, channels)
    elif kind == "os":
        z, weight = _rank_density(total, rank or 1, channels)
    else:
        z, weight = _half_density(kind, halves, channels)

    def excess(log_alpha):
        """ln(rate of this multiplier / wanted rate)."""
        exceeds = scipy.special.gammaincc(channels, math.exp(log_alpha) * z)
        return math.log(max(np.sum(weight * exceeds), 1e-300) / rate)

    log_alpha: Any = scipy.optimize.brentq(excess, -30.0, 30.0, xtol=1e-14)
    return math.exp(log_alpha)


def _log_grid(shape, scale=1.0):
    """Points z, and their step in ln z, to integrate over Gamma(shape, 1) / scale."""
    low, high = (
        scipy.special.gammaincinv(shape, TAIL),
        scipy.special.gammainccinv(shape, TAIL),
    )
    step = min(0.02, 0.1 / math.sqrt(shape))
    return np.exp(np.arange(math.log(low), math.log(high) + step, step)) / scale, step


def _log_gamma_density(z, shape, scale=1.0):
    """Log density of Gamma(shape, 1) / scale with respect to ln z."""
    return shape * np.log(scale * z) - scale * z - scipy.special.gammaln(shape)


def _mean_density(cells, channels):
    """Quadrature points and weights of the mean of all cells."""
    shape = cells * channels
    z, step = _log_grid(shape, cells)
    return z, np.exp(_log_gamma_density(z, shape, cells)) * step


def _rank_density(cells, rank, channels):
    """Quadrature points and weights of the cell at a rank."""
    z, step = _log_grid(channels)
    below, above = (
        scipy.special.gammainc(channels, z),
        scipy.special.gammaincc(channels, z),
    )
    log_density = (
        scipy.special.xlogy(rank - 1, below)
        + scipy.special.xlogy(cells - rank, above)
        - scipy.special.betaln(rank, cells - rank + 1)
        + _log_gamma_density(z, channels)
    )
    return z, np.exp(log_density) * step


def _half_density(kind, halves, channels):
    """Quadrature points and weights of the greater or smaller mean of two halves."""
    # The smaller half has the widest density, the larger one needs the finest step.
    grids = [_log_grid(n * channels, n) for n in halves]
    step = min(step for _, step in grids)
    low, high = min(z[0] for z, _ in grids), max(z[-1] for z, _ in grids)
    z = np.exp(np.arange(math.log(low), math.log(high) + step, step))
    share = scipy.special.gammainc if kind == "go" else scipy.special.gammaincc
    weight = sum(
        np.exp(_log_gamma_density(z, one * channels, one))
        * share(other * channels, other * z)
        for one, other in (halves, halves[::-1])
    )
    return z, weight * step
