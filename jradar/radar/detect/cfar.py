"""Constant-false-alarm-rate (CFAR) detectors on range-Doppler maps.

A cell x is compared with the noise around it. The noise is estimated from the `train`
cells on every side, without the `guard` cells next to x:

    a a a A t t t
    a a g g g t t      guard = (1, 1), train = (1, 2), in (doppler, range)
    a a g x g t t
    a a g g g t t      GO and SO compare two halves: the cells at lower range
    a a a t t t t      (a, and A in x's own column) and the other ones (t)

With guard = (0, 1), train = (0, 2) only the middle row remains: a detector along range.

Detectors take linear power summed over `channels` antennas, with trailing axes
[doppler, range], and return a boolean mask of the same shape. Leading axes are
independent maps. Sums never subtract, so a strong target leaves no rounding error.

The kinds of detectors differ in their noise estimate:

    ca    cell averaging: the mean of all training cells
    go    greatest of the means of two halves: fewer false alarms where clutter begins
    so    smallest of the two means: finds targets next to other targets
    os    ordered statistic: the training cell at three quarters of the rank

Doppler wraps around. `edge` says what happens at the ends of the range axis:

    shrink      the window loses the cells beyond the map; the multiplier allows for it
    one_sided   the half that is not complete is left out (TI's mmWave SDK and CASO)
    fill        missing cells are taken from the other side (MATLAB's CFARDetector);
                CA and OS along range only
    reflect     the map continues mirrored, its last cell once (NumPy's reflect)
    wrap        range wraps around as Doppler does
    skip        cells without a complete window are not detected (MATLAB's
                CFARDetector2D, for both axes)

A fixed `factor` replaces the rate, to reproduce other detectors.

Multipliers are exact for square-law noise that is independent from cell to cell (see
`multipliers`). They are computed on the host, so the rate is static. A rate of 1
detects every cell that is not zero: the paper's threshold "approaching zero".

A window over the samples correlates the noise of neighbouring cells. Name the windows
of the spectrum in `windows`, (doppler, range), and the multiplier accounts for them
(see `correlation`); `radar_points` does. Without it, the rate of windowed noise is
higher than asked: up to 2.3 times with Hann and 2.9 times with Blackman for SO.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Num

from jradar.compiled import jit
from jradar.options.detectors import GUARD, KINDS, TRAIN, Window, check_window
from jradar.radar.detect.cfar_window import (
    cells_per_range_bin,
    count_below,
    halves_counted,
    inside,
    pad,
    sums_of_halves,
)
from jradar.radar.detect.correlation import independent_cells
from jradar.radar.detect.multipliers import false_alarm_multiplier
from jradar.radar.ranks import to_rank

RANK = 0.75  # of the ordered statistic, as a fraction of the training cells
STATIC = (
    *("kind", "false_alarm_rate", "channels", "guard", "train", "windows"),
    *("edge", "factor"),
)
NO_WINDOWS = ("none", "none")

Power = Num[Array, "*batch doppler range"]
Map = Float[Array, "*batch doppler range"]
Mask = Bool[Array, "*batch doppler range"]


@jit(static_argnames=STATIC)
def cfar(
    power: Power,
    *,
    kind: str,
    false_alarm_rate: float | None = None,
    channels: int = 1,
    guard: tuple[int, int] = GUARD,
    train: tuple[int, int] = TRAIN,
    windows: tuple[str, str] = NO_WINDOWS,
    edge: str = "shrink",
    factor: float | None = None,
) -> Mask:
    """Return the cells that the detector of this kind marks: "ca", "go", "so" or "os".

    `edge` is one of the rules above. `factor` on the noise estimate replaces the rate.
    Raises ValueError if the window does not fit into the map, and for a map that holds
    no power.
    """
    power, window = linear_power(power), Window(guard, train, edge)
    check_window(window, kind)
    given = factor is not None
    if given == (false_alarm_rate is not None) or (given and not factor > 0):
        raise ValueError(
            f"CFAR {false_alarm_rate=}, {factor=}: expected one of them, a factor of "
            "more than 0"
        )
    shape = power.shape[-2:]
    multiplier = [factor] * shape[1]
    if false_alarm_rate is not None:
        multiplier = _multipliers(
            kind, false_alarm_rate, channels, shape, window, windows
        )
    multiplier = to_rank(np.asarray(multiplier, power.dtype), power)
    if kind != "os":
        mask = power > multiplier * _mean_floor(kind, power, window)
    else:
        # No cell is sorted: x exceeds alpha times the k-th smallest cell exactly when
        # at least k cells lie below x / alpha.
        count, rank = _counter(power, jnp.inf, window)
        mask = count(power / multiplier) >= rank
    if edge == "fill":
        ends, floor = _filled_ends(kind, power, window)
        above = power[..., ends] > multiplier[..., ends] * floor
        return mask.at[..., ends].set(above)
    if edge == "skip":
        return mask & to_rank(inside(shape[1], window), power)
    return mask


DETECTORS = {kind: functools.partial(cfar, kind=kind) for kind in KINDS}
ca_cfar, go_cfar, so_cfar, os_cfar = DETECTORS.values()


@jit(static_argnames=("kind", "guard", "train", "edge"))
def noise_floor(
    power: Power,
    *,
    kind: str = "ca",
    guard: tuple[int, int] = GUARD,
    train: tuple[int, int] = TRAIN,
    edge: str = "shrink",
) -> Map:
    """The noise estimate of a detector of `kind`, without the multiplier.

    The SNR of a cell is its power over this. The ordered statistic is exact. It is
    found by bisection over the bits of float32, which are ordered like the numbers, so
    its gradient is 0. The other kinds have gradients with respect to the cells.
    """
    power, window = linear_power(power), Window(guard, train, edge)
    check_window(window, kind)
    estimate = _ordered_floor if kind == "os" else functools.partial(_mean_floor, kind)
    floor = estimate(power, window)
    if edge == "fill":
        ends, values = _filled_ends(kind, power, window)
        floor = floor.at[..., ends].set(values)
    return floor


def linear_power(power: Power) -> Map:
    """Return a power map in float32, or in float64 if it already is.

    Raises ValueError for values that are not powers and for a map without both axes.
    """
    power = jnp.asarray(power)
    if power.ndim < 2:
        raise ValueError(
            f"power has shape {power.shape}, expected [..., doppler, range]: for one "
            "profile pass power[None] with guard=(0, cells), train=(0, cells)"
        )
    if jnp.iscomplexobj(power) or power.dtype == bool:
        raise ValueError(
            f"power is {power.dtype}, expected linear power: pass abs(spectrum) ** 2, "
            "summed over antennas"
        )
    return power if power.dtype == jnp.float64 else power.astype(jnp.float32)


def _counter(values, beyond, window):
    """The function that counts training cells below a level, and the rank of "os"."""
    low, high = cells_per_range_bin(values.shape, window)
    padded = pad(values, window, beyond)
    counted = halves_counted(low, high, values) if window.edge == "one_sided" else None

    def count(level):
        return count_below(level, padded, window, counted)

    return count, to_rank(_rank(low + high), values)


def _ordered_floor(power, window):
    """The training cell at the rank, apart from the ends of "fill"."""
    keys = jax.lax.bitcast_convert_type(power.astype(jnp.float32), jnp.int32)
    count, rank = _counter(keys, jnp.iinfo(jnp.int32).max, window)

    def refine(i, found):
        """Set the next lower bit where fewer than k cells lie below the result."""
        candidate = found | (jnp.int32(1) << (30 - i))
        return jnp.where(count(candidate) < rank, candidate, found)

    found = jax.lax.fori_loop(0, 31, refine, jnp.zeros_like(keys))
    return jax.lax.bitcast_convert_type(found, jnp.float32)


def _filled_ends(kind, power, window):
    """Range bins at the ends, and their floor from the nearest 2 * train cells."""
    (_, guard), (_, train), _ = window
    bins, cells = power.shape[-1], 2 * train
    ends = np.flatnonzero(~inside(bins, window))
    chosen = []
    for end in ends:
        low, high = np.arange(end - guard), np.arange(end + guard + 1, bins)
        taken = min(len(low), max(train, cells - len(high)))
        chosen.append(np.concatenate([low[len(low) - taken :], high[: cells - taken]]))
    near = power[..., np.array(chosen)]
    if kind == "ca":
        return ends, near.mean(-1)
    return ends, jnp.sort(near, -1)[..., _rank(cells) - 1]


def _mean_floor(kind, power, window):
    """Mean of all training cells, or of the greater or smaller half."""
    both = cells_per_range_bin(power.shape, window)
    sums = sums_of_halves(power, window)

    def share(cells):
        return to_rank(np.asarray(1 / np.maximum(cells, 1), power.dtype), power)

    counted = halves_counted(*both, power)
    if window.edge == "one_sided":
        sums = [jnp.where(*pair, 0) for pair in zip(counted, sums, strict=True)]
    if kind == "ca":
        return (sums[0] + sums[1]) * share(sum(both))
    low, high = (half * share(cells) for half, cells in zip(sums, both, strict=True))
    # At the ends of the range axis one half may be empty: use the other one.
    low, high = jnp.where(counted[0], low, high), jnp.where(counted[1], high, low)
    return jnp.maximum(low, high) if kind == "go" else jnp.minimum(low, high)


def _rank(cells):
    """Rank of the ordered statistic among this number of training cells; host."""
    return np.ceil(RANK * cells - 1e-9).astype(int)


@functools.lru_cache(256)
def _multipliers(kind, rate, channels, shape, window, tapers):
    """Multiplier of each range bin for `tapers` over chirps and samples; host."""
    low, high = cells_per_range_bin(shape, window)

    @functools.cache
    def multiplier(column):
        halves = int(low[column]), int(high[column])
        cells, count = halves, sum(halves)
        if tapers != NO_WINDOWS:
            cells = _effective(kind, column, shape, window, tapers, halves)
        if kind in ("go", "so"):
            return false_alarm_multiplier(kind, rate, cells, channels=channels)
        number, rank = sum(cells), None
        if kind == "os":  # the rank at the same quantile of fewer cells
            rank = min(int(_rank(count)) * (number + 1) / (count + 1), number)
        return false_alarm_multiplier(kind, rate, number, rank=rank, channels=channels)

    # All bins with a whole window are alike.
    whole, side = inside(shape[1], window), window.sides[1]
    return [multiplier(side if whole[i] else i) for i in range(shape[1])]


def _effective(kind, column, shape, window, tapers, halves):
    """Independent cells of both halves; for CA and OS (those of all cells, 0)."""
    (guard_rows, guard_columns), _, edge = window
    offsets = [np.arange(-side, side + 1) for side in window.sides]
    rows, columns = np.meshgrid(*offsets, indexing="ij")
    cells = (abs(rows) > guard_rows) | (abs(columns) > guard_columns)
    low = (columns < 0) | ((columns == 0) & (rows < 0))
    if edge == "shrink":
        cells &= (column + columns >= 0) & (column + columns < shape[1])
    cells &= np.where(low, *(half > 0 for half in halves))
    count = functools.partial(independent_cells, windows=tapers, shape=shape)
    if kind in ("go", "so"):
        return count(cells & low), count(cells & ~low)
    return count(cells, quantile=RANK if kind == "os" else None), 0.0
