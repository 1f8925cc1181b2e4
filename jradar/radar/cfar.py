"""Constant-false-alarm-rate (CFAR) detectors on range-Doppler maps.

A cell x is compared with the noise around it, estimated from `train` cells on every
side, leaving out the `guard` cells nearest to it:

    t t t t t t t
    t t g g g t t      guard = (1, 1), train = (1, 2), in (doppler, range);
    t t g x g t t      train = (0, 2) and guard = (0, 1) leave the middle row:
    t t g g g t t      a detector along range only
    t t t t t t t

Detectors take linear power summed over `channels` antennas, with trailing axes
[doppler, range], and return a boolean mask of the same shape; leading axes are
independent maps. Doppler wraps around; at the ends of the range axis the window keeps
the cells that exist, and the multiplier is the one for their number. Sums never
subtract, so a strong target leaves no rounding error beside it.

The multiplier is exact for square-law noise that is independent from cell to cell
(Gandhi & Kassam 1988; Rohling 1983 for OS). It is computed on the host in float64,
which is why the rate is static. A rate of 1 turns every cell that is not zero into a
detection: the paper's threshold "approaching zero".
"""

import functools
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy import optimize, special

KINDS = ("ca", "go", "so", "os")
STATIC = ("false_alarm_rate", "channels", "guard", "train")

Map = Float[Array, "*batch doppler range"]
Mask = Bool[Array, "*batch doppler range"]


@functools.cache
def false_alarm_multiplier(
    kind: str, rate: float, cells: int, *, rank: int | None = None, channels: int = 1
) -> float:
    """Factor on the noise estimate of `cells` cells that yields the false-alarm rate.

    Host function. `kind` is "ca" (mean of all), "go" or "so" (greater or smaller of the
    means of two halves) or "os" (the `rank`-th smallest, counted from 1); each cell is
    a sum over `channels` exponential variables.
    """
    if kind not in KINDS:
        raise ValueError(f"CFAR kind {kind!r}, expected one of {KINDS}")
    if not 0 < rate <= 1:
        raise ValueError(f"false_alarm_rate = {rate}, expected 0 < rate <= 1")
    if cells < 1 or (kind in ("go", "so") and cells % 2):
        raise ValueError(f"{kind} CFAR with {cells=}, expected a positive even number")
    if kind == "os" and not (rank and 1 <= rank <= cells):
        raise ValueError(f"OS-CFAR {rank=}, expected 1 to {cells}")
    if rate == 1:
        return 0.0

    # The estimate Z is made of Gamma(m, 1) variables; P(Z <= z) = I_{P(m, z)}(a, b).
    m, a, b, scale = {
        "ca": (cells * channels, 1, 1, cells),
        "go": (cells // 2 * channels, 2, 1, cells / 2),
        "so": (cells // 2 * channels, 1, 2, cells / 2),
        "os": (channels, rank or 1, cells - (rank or 1) + 1, 1),
    }[kind]
    low, high = special.gammaincinv(m, 1e-18), special.gammainccinv(m, 1e-18)
    step = min(0.02, 0.1 / math.sqrt(m))
    log_z = np.arange(math.log(low), math.log(high) + step, step)
    z = np.exp(log_z)
    log_density = (
        special.xlogy(a - 1, special.gammainc(m, z))
        + special.xlogy(b - 1, special.gammaincc(m, z))
        - special.betaln(a, b)
        + special.xlogy(m, z)
        - z
        - special.gammaln(m)
    )
    weight = np.exp(log_density) * step

    def excess(log_alpha):
        """ln(rate at this multiplier / rate asked for)."""
        exceeds = special.gammaincc(channels, math.exp(log_alpha) / scale * z)
        return math.log(max(np.sum(weight * exceeds), 1e-300) / rate)

    log_alpha: Any = optimize.brentq(excess, -30.0, 30.0, xtol=1e-14)
    return math.exp(log_alpha)


@functools.partial(jax.jit, static_argnames=STATIC)
def ca_cfar(
    power: Map,
    *,
    false_alarm_rate: float,
    channels: int = 1,
    guard: tuple[int, int] = (2, 2),
    train: tuple[int, int] = (4, 4),
) -> Mask:
    """Cell averaging: the noise is the mean of all training cells.

    Raises ValueError where the window does not fit into the map.
    """
    cells = _cells_per_range_bin(power.shape, guard, train)
    multiplier = [
        false_alarm_multiplier("ca", false_alarm_rate, int(n), channels=channels)
        for n in cells
    ]
    total = _sum_of_training_cells(_pad(power, guard, train, 0.0), guard, train)
    return power > jnp.asarray(multiplier / cells, power.dtype) * total


@functools.partial(jax.jit, static_argnames=(*STATIC, "rank"))
def os_cfar(
    power: Map,
    *,
    false_alarm_rate: float,
    channels: int = 1,
    guard: tuple[int, int] = (2, 2),
    train: tuple[int, int] = (4, 4),
    rank: float = 0.75,
) -> Mask:
    """Ordered statistic: the noise is the training cell of rank `rank * cells`.

    Decides by counting: x exceeds alpha times the k-th smallest cell exactly when at
    least k cells lie below x / alpha, and no cell is sorted. Raises ValueError where
    the window does not fit into the map.
    """
    if not 0 < rank <= 1:
        raise ValueError(f"OS-CFAR {rank=}, expected a fraction, 0 < rank <= 1")
    cells = _cells_per_range_bin(power.shape, guard, train)
    k = np.ceil(rank * cells - 1e-9).astype(int)
    multiplier = [
        false_alarm_multiplier("os", false_alarm_rate, n, rank=r, channels=channels)
        for n, r in zip(cells.tolist(), k.tolist(), strict=True)
    ]
    level = power / jnp.asarray(multiplier, power.dtype)
    padded = _pad(power, guard, train, jnp.inf)
    return _count_below(level, padded, guard, train) >= jnp.asarray(k)


def largest_window(
    shape: tuple[int, ...], guard: tuple[int, int], train: tuple[int, int]
) -> tuple[tuple[int, int], tuple[int, int]]:
    """The given `guard` and `train`, cut down to what fits a map [doppler, range]."""
    doppler, range_ = ((bins - 1) // 2 for bins in shape[-2:])
    train = (min(train[0], doppler), min(train[1], range_))
    guard = (min(guard[0], doppler - train[0]), min(guard[1], range_ - train[1]))
    return guard, train


def _cells_per_range_bin(shape, guard, train):
    """Training cells of each range bin `[range]`, fewer at the ends; host."""
    for axis, bins, g, t in zip(
        ("Doppler", "range"), shape[-2:], guard, train, strict=True
    ):
        if g < 0 or t < 0:
            raise ValueError(f"CFAR {guard=}, {train=}: expected 0 or more cells")
        if 2 * (g + t) + 1 > bins:
            raise ValueError(
                f"CFAR window of {2 * (g + t) + 1} cells (guard {g}, train {t} on a "
                f"side) does not fit in {bins} {axis} bins: the most that fits is "
                f"guard + train = {(bins - 1) // 2}"
            )
    if not any(train):
        raise ValueError(f"CFAR {train=}: expected training cells along some axis")
    bins = np.arange(shape[-1])
    rows = [2 * (guard[0] + train[0]) + 1, 2 * guard[0] + 1]
    columns = [
        np.minimum(bins, half) + np.minimum(bins[::-1], half) + 1
        for half in (guard[1] + train[1], guard[1])
    ]
    return rows[0] * columns[0] - rows[1] * columns[1]


def _pad(power, guard, train, fill):
    """Map with room for the window: Doppler wraps around, range ends in `fill`."""
    leading = [(0, 0)] * (power.ndim - 2)
    doppler, range_ = (g + t for g, t in zip(guard, train, strict=True))
    power = jnp.pad(power, [*leading, (doppler, doppler), (0, 0)], mode="wrap")
    return jnp.pad(power, [*leading, (0, 0), (range_, range_)], constant_values=fill)


def _sliding_sum(values, size, axis) -> Any:
    """Sums over `size` neighbours, by doubling; the axis gets shorter by size - 1."""
    length = values.shape[axis] - size + 1
    total: Any = None
    offset, width = 0, 1
    while True:
        if size & 1:
            part = jax.lax.slice_in_dim(values, offset, offset + length, axis=axis)
            total = part if total is None else total + part
            offset += width
        size >>= 1
        if not size:
            return total
        end = values.shape[axis]
        values = jax.lax.slice_in_dim(
            values, 0, end - width, axis=axis
        ) + jax.lax.slice_in_dim(values, width, end, axis=axis)
        width *= 2


def _sum_of_training_cells(padded, guard, train):
    """Sum over the ring of training cells, as four strips."""
    (gd, gr), (td, tr) = guard, train
    doppler = padded.shape[-2] - 2 * (gd + td)
    bins = padded.shape[-1] - 2 * (gr + tr)
    total = 0.0
    if td:
        wide = _sliding_sum(padded, 2 * (gr + tr) + 1, -1)
        strip = _sliding_sum(wide, td, -2)
        below = 2 * gd + td + 1
        total += strip[..., :doppler, :] + strip[..., below : below + doppler, :]
    if tr:
        tall = _sliding_sum(padded[..., td : padded.shape[-2] - td, :], 2 * gd + 1, -2)
        strip = _sliding_sum(tall, tr, -1)
        right = 2 * gr + tr + 1
        total += strip[..., :bins] + strip[..., right : right + bins]
    return total


def _count_below(level, padded, guard, train):
    """How many training cells lie below `level`, a row of the window at a time."""
    (gd, gr), (td, tr) = guard, train
    doppler, bins = level.shape[-2:]
    width = 2 * (gr + tr) + 1
    sides = [*range(tr), *range(width - tr, width)]

    def count(rows, columns, total):
        def add(i, total):
            row = jax.lax.dynamic_slice_in_dim(
                padded, jnp.asarray(rows)[i], doppler, axis=-2
            )
            for column in columns:
                total += row[..., column : column + bins] < level
            return total

        return jax.lax.fori_loop(0, len(rows), add, total) if len(rows) else total

    beyond = [*range(td), *range(2 * gd + td + 1, 2 * (gd + td) + 1)]
    beside = [*range(td, 2 * gd + td + 1)] if tr else []
    total = count(beyond, range(width), jnp.zeros(level.shape, jnp.int32))
    return count(beside, sides, total)
