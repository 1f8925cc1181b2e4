"""How many independent cells scatter as much as the training cells; host.

A window over the samples makes neighbouring cells of a spectrum alike: with Hann, cells
next to each other share 4/9 of their variance, cells two bins apart 1/36. The mean of n
such cells scatters as the mean of fewer independent ones, and so does a rank:

    n_eff = n^2 / sum_ij c(r_ij)      r = |autocorrelation of the window's spectrum|^2
    mean: c(r) = r
    rank: c(r) = correlation of "cell i is below the quantile" and the same of cell j

Summed power of several antennas is nearly normal, which gives the second c as a series
in r (Mehler's formula). Tested cells are independent of their training cells only if
the guard cells cover the window's main lobe: two cells on a side with Hann, three with
Blackman. With fewer, the false-alarm rate falls below the one asked for.
"""

import functools
import math

import numpy as np
import scipy  # loads `special` when it is first used
from numpy.polynomial.hermite_e import hermeval

from jradar.radar.spectrum import window

TERMS = 12  # of Mehler's series
LEAST = 1e-6  # shares below it do not count


def shared_variance(kind: str, bins: int) -> np.ndarray:
    """Return r of cells at lags 0 .. bins - 1 for this window; host."""
    spectrum = np.abs(np.fft.fft(window(kind, bins) ** 2))
    return (spectrum / spectrum[0]) ** 2


@functools.cache
def shared_indicator(share: float, quantile: float) -> float:
    """Return the correlation of two cells' being below a quantile, for r = `share`."""
    if share >= 1:
        return 1.0
    x = scipy.special.ndtri(quantile)
    density = math.exp(-(x**2)) / (2 * math.pi)
    terms = [
        share**k / math.factorial(k) * hermeval(x, [0] * (k - 1) + [1]) ** 2
        for k in range(1, TERMS + 1)
    ]
    return density * float(np.sum(terms)) / (quantile * (1 - quantile))


def independent_cells(
    mask: np.ndarray,
    windows: tuple[str, str],
    shape: tuple[int, int],
    *,
    quantile: float | None = None,
) -> float:
    """Return n_eff of the cells in `mask` [doppler, range], part of a map of `shape`.

    `windows` are those over chirps and samples. With `quantile` it is n_eff for the
    rank at that quantile, otherwise for the mean; host.
    """
    # Shares at lags -size + 1 .. size - 1 of the mask, along Doppler and range.
    shares = np.outer(
        *(
            shared_variance(kind, bins)[np.arange(1 - size, size) % bins]
            for kind, bins, size in zip(windows, shape, mask.shape, strict=True)
        )
    )
    total = 0.0
    for d, r in np.argwhere(shares > LEAST):
        share = float(shares[d, r])
        if quantile is not None:
            share = shared_indicator(share, quantile)
        total += share * _pairs(mask, d + 1 - mask.shape[0], r + 1 - mask.shape[1])
    count = int(mask.sum())
    return round(min(count**2 / total, count), 9) if count else 0.0


def _pairs(mask, d, r):
    """Number of pairs of cells in the mask that lie (d, r) apart."""
    rows, columns = (n - abs(k) for n, k in zip(mask.shape, (d, r), strict=True))
    here = mask[max(d, 0) : max(d, 0) + rows, max(r, 0) : max(r, 0) + columns]
    there = mask[max(-d, 0) : max(-d, 0) + rows, max(-r, 0) : max(-r, 0) + columns]
    return int((here & there).sum())
