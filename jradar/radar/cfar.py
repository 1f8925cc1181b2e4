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
[doppler, range], and return a boolean mask of the same shape. Integers and floats of
half precision become float32; complex spectra are refused. Leading axes are independent
maps. Sums never subtract, so a strong target leaves no rounding error beside it.

Doppler wraps around. `edge` says what happens at the ends of the range axis:

    shrink      the window loses the cells beyond the map; the multiplier knows
    one_sided   the half that is not complete is left out (TI's mmWave SDK and CASO)
    fill        missing cells are taken from the other side (MATLAB's CFARDetector);
                CA and OS along range only
    reflect     the map goes on mirrored, without its last cell twice (NumPy's reflect)
    wrap        range wraps around as Doppler does
    skip        cells without a complete window are not detected (MATLAB's
                CFARDetector2D, for both axes)

A fixed `factor` replaces the rate, to repeat others' detectors. TI's detection matrices
hold logarithms, so that their factor is an offset: compare them with `noise_floor` of
the matrix plus the offset.

Multipliers are exact for square-law noise that is independent from cell to cell (see
`multipliers`). They are computed on the host, so the rate is static. A rate of 1
detects every cell that is not zero: the paper's threshold "approaching zero".

A window over the samples correlates the noise of neighbouring cells. Name the windows
of the spectrum in `windows`, (doppler, range), and the multiplier accounts for them
(see `correlation`); `radar_points` does. Without it, the rate of windowed noise is
higher than asked: up to 2.3 times with Hann and 2.9 times with Blackman for SO.
"""

import functools
import operator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Num

from jradar.radar.correlation import independent_cells
from jradar.radar.multipliers import KINDS, false_alarm_multiplier
from jradar.radar.ranks import to_rank

GUARD, TRAIN = (2, 2), (4, 4)  # cells on a side in (doppler, range)
RANK = 0.75  # of the ordered statistic, as a fraction of the training cells
STATIC = (
    *("kind", "false_alarm_rate", "channels", "guard", "train", "windows"),
    *("edge", "factor"),
)
EDGES = ("shrink", "one_sided", "fill", "reflect", "wrap", "skip")
NO_WINDOWS = ("none", "none")
MAX_COMPARISONS = 96  # in one fused kernel: XLA stops vectorising beyond about 100

Power = Num[Array, "*batch doppler range"]
Map = Float[Array, "*batch doppler range"]
Mask = Bool[Array, "*batch doppler range"]


def _plain_window(function):
    """Let a jitted function take `guard` and `train` as lists: jit needs tuples."""

    @functools.wraps(function)
    def call(power, **options):
        window = {
            k: cell_pair(k, options[k]) for k in ("guard", "train") if k in options
        }
        return function(power, **(options | window))

    return call


@_plain_window
@functools.partial(jax.jit, static_argnames=STATIC)
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

    `edge` is one of `EDGES`. `factor` on the noise estimate replaces the rate. Raises
    ValueError if the window does not fit into the map, and for a map that holds no
    power.
    """
    power = linear_power(power)
    check_edge(edge, kind, train)
    low, high = _cells_per_range_bin(power.shape, guard, train, edge)
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
            kind, false_alarm_rate, channels, shape, guard, train, windows, edge
        )
    multiplier = to_rank(np.asarray(multiplier, power.dtype), power)
    if kind != "os":
        mask = power > multiplier * _mean_floor(kind, power, guard, train, edge)
    else:
        # No cell is sorted: x exceeds alpha times the k-th smallest cell exactly when
        # at least k cells lie below x / alpha.
        level = power / multiplier
        padded = _pad(power, guard, train, jnp.inf, edge)
        counted = _halves_counted(low, high, power) if edge == "one_sided" else None
        count = _count_below(level, padded, guard, train, counted)
        mask = count >= to_rank(_rank(low + high), power)
    if edge == "fill":
        ends, floor = _filled_ends(kind, power, guard, train)
        above = power[..., ends] > multiplier[..., ends] * floor
        return mask.at[..., ends].set(above)
    if edge == "skip":
        return mask & to_rank(_inside(shape[1], guard, train), power)
    return mask


def ca_cfar(power: Power, **options: Any) -> Mask:
    """Cell averaging: `cfar` above the mean of all training cells."""
    return cfar(power, kind="ca", **options)


def go_cfar(power: Power, **options: Any) -> Mask:
    """Greatest of: `cfar` above the greater of the means of two halves.

    It gives fewer false alarms where clutter begins.
    """
    return cfar(power, kind="go", **options)


def so_cfar(power: Power, **options: Any) -> Mask:
    """Smallest of: `cfar` above the smaller of the means of two halves.

    It finds targets beside other targets.
    """
    return cfar(power, kind="so", **options)


def os_cfar(power: Power, **options: Any) -> Mask:
    """Ordered statistic: `cfar` above the cell at three quarters of the rank."""
    return cfar(power, kind="os", **options)


DETECTORS = {"ca": ca_cfar, "go": go_cfar, "so": so_cfar, "os": os_cfar}


@_plain_window
@functools.partial(jax.jit, static_argnames=("kind", "guard", "train", "edge"))
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
    its gradient is 0; those of the other kinds reach the training cells.
    """
    if kind not in KINDS:
        raise ValueError(f"CFAR kind {kind!r}, expected one of {KINDS}")
    power = linear_power(power)
    check_edge(edge, kind, train)
    floor = _floor(kind, power, guard, train, edge)
    if edge == "fill":
        ends, values = _filled_ends(kind, power, guard, train)
        floor = floor.at[..., ends].set(values)
    return floor


def _floor(kind, power, guard, train, edge):
    """The noise estimate, apart from the ends of "fill"."""
    if kind != "os":
        return _mean_floor(kind, power, guard, train, edge)
    low, high = _cells_per_range_bin(power.shape, guard, train, edge)
    ranks = to_rank(_rank(low + high), power)
    keys = jax.lax.bitcast_convert_type(power.astype(jnp.float32), jnp.int32)
    padded = _pad(keys, guard, train, jnp.iinfo(jnp.int32).max, edge)
    counted = _halves_counted(low, high, power) if edge == "one_sided" else None

    def refine(i, found):
        """Set the next lower bit where fewer than k cells lie below the result."""
        candidate = found | (jnp.int32(1) << (30 - i))
        fewer = _count_below(candidate, padded, guard, train, counted) < ranks
        return jnp.where(fewer, candidate, found)

    found = jax.lax.fori_loop(0, 31, refine, jnp.zeros_like(keys))
    return jax.lax.bitcast_convert_type(found, jnp.float32)


def linear_power(power: Power) -> Map:
    """Return a power map in float32, or in float64 if it is.

    Raises ValueError for values that are no power and for a map without both axes.
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


def cell_pair(name: str, cells: Any) -> tuple[int, int]:
    """Return cells in (doppler, range) as a tuple; ValueError if they are not two."""
    try:
        doppler, range_ = (operator.index(number) for number in cells)
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"CFAR {name} = {cells!r}, expected two whole numbers: cells in "
            "(doppler, range)"
        ) from error
    return doppler, range_


def largest_window(
    shape: tuple[int, ...], guard: tuple[int, int], train: tuple[int, int]
) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return `guard` and `train` shrunk until they fit into a map [doppler, range]."""
    doppler, range_ = ((bins - 1) // 2 for bins in shape[-2:])
    train = (min(train[0], doppler), min(train[1], range_))
    guard = (min(guard[0], doppler - train[0]), min(guard[1], range_ - train[1]))
    return guard, train


def check_edge(edge: str, kind: str, train: tuple[int, int]) -> None:
    """Raise ValueError for a rule at the ends that is unknown or does not fit."""
    if edge not in EDGES:
        raise ValueError(f"CFAR {edge=}, expected one of {EDGES}")
    if edge == "fill" and (train[0] or kind in ("go", "so")):
        raise ValueError(
            f"CFAR edge='fill' with {kind=}, {train=}: expected ca or os along range "
            "only, train = (0, cells)"
        )


def _inside(bins, guard, train):
    """Whether the whole window of a range bin exists; host."""
    side, number = guard[1] + train[1], np.arange(bins)
    return (number >= side) & (number < bins - side)


def _halves_counted(low, high, power):
    """Which halves count in each range bin."""
    return [to_rank(cells > 0, power) for cells in (low, high)]


def _filled_ends(kind, power, guard, train):
    """Range bins at the ends, and their floor from the nearest 2 * train cells."""
    bins, cells = power.shape[-1], 2 * train[1]
    ends = np.flatnonzero(~_inside(bins, guard, train))
    number = np.arange(bins)
    chosen = []
    for end in ends:
        apart = abs(number - end)
        beside = number[apart > guard[1]]
        low, high = beside[beside < end], beside[beside > end]
        taken = min(len(low), max(train[1], cells - len(high)))
        chosen.append(np.concatenate([low[len(low) - taken :], high[: cells - taken]]))
    near = power[..., np.array(chosen)]
    if kind == "ca":
        return ends, near.mean(-1)
    return ends, jnp.sort(near, -1)[..., _rank(cells) - 1]


def _mean_floor(kind, power, guard, train, edge):
    """Mean of all training cells, or of the greater or smaller half."""
    low, high = _cells_per_range_bin(power.shape, guard, train, edge)
    sums = _sums_of_halves(power, guard, train, edge)
    if edge == "one_sided":
        sums = [
            jnp.where(counts, half, 0)
            for counts, half in zip(
                _halves_counted(low, high, power), sums, strict=True
            )
        ]
    if kind == "ca":
        return (sums[0] + sums[1]) * to_rank(
            np.asarray(1 / (low + high), power.dtype), power
        )
    means = [
        half * to_rank(np.asarray(1 / np.maximum(cells, 1), power.dtype), power)
        for half, cells in zip(sums, (low, high), strict=True)
    ]
    # At the ends of the range axis one half may be empty: use the other one.
    means = [
        jnp.where(to_rank(cells > 0, power), mean, other)
        for mean, other, cells in zip(means, means[::-1], (low, high), strict=True)
    ]
    return jnp.maximum(*means) if kind == "go" else jnp.minimum(*means)


def _rank(cells):
    """Rank of the ordered statistic among this number of training cells; host."""
    return np.ceil(RANK * cells - 1e-9).astype(int)


def _cells_per_range_bin(shape, guard, train, edge):
    """Number of training cells of each range bin in the two halves; host."""
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
    (gd, gr), (td, tr) = guard, train
    before = np.arange(shape[-1])  # number of bins at lower range
    if edge != "shrink":
        number = np.full(len(before), (2 * (gd + td) + 1) * tr + 2 * td * gr + td)
        if edge != "one_sided":
            return number, number
        low = np.where(before >= gr + tr, number, 0)
        return low, low[::-1]

    def half(exist):
        window, guarded = (np.minimum(exist, n) for n in (gr + tr, gr))
        return (2 * (gd + td) + 1) * window - (2 * gd + 1) * guarded + td

    return half(before), half(before[::-1])


@functools.lru_cache(256)
def _multipliers(kind, rate, channels, shape, guard, train, windows, edge):
    """Multiplier of each range bin; host."""
    low, high = _cells_per_range_bin(shape, guard, train, edge)
    side, known = guard[1] + train[1], {}
    places = [(min(i, side), min(shape[1] - 1 - i, side)) for i in range(shape[1])]
    for column, place in enumerate(places):
        if place in known:
            continue
        halves = int(low[column]), int(high[column])
        effective = halves
        if windows != NO_WINDOWS:
            effective = _effective(
                kind, column, shape, guard, train, windows, edge, halves
            )
        number, rank = sum(effective), None
        if kind == "os":  # the rank at the same quantile of fewer cells
            cells = sum(halves)
            rank = min(int(_rank(cells)) * (number + 1) / (cells + 1), number)
        known[place] = false_alarm_multiplier(
            kind,
            rate,
            effective if kind in ("go", "so") else number,
            rank=rank,
            channels=channels,
        )
    return [known[place] for place in places]


def _effective(kind, column, shape, guard, train, windows, edge, halves):
    """Independent cells of both halves; for CA and OS (those of all cells, 0)."""
    sides = [g + t for g, t in zip(guard, train, strict=True)]
    offsets = [np.arange(-side, side + 1) for side in sides]
    rows, columns = np.meshgrid(*offsets, indexing="ij")
    near = (abs(rows) <= guard[0]) & (abs(columns) <= guard[1])
    cells = ~near
    low = (columns < 0) | ((columns == 0) & (rows < 0))
    if edge == "shrink":
        cells &= (column + columns >= 0) & (column + columns < shape[1])
    cells &= (low & (halves[0] > 0)) | (~low & (halves[1] > 0))
    count = functools.partial(independent_cells, windows=windows, shape=shape)
    if kind in ("go", "so"):
        return count(cells & low), count(cells & ~low)
    return count(cells, quantile=RANK if kind == "os" else None), 0.0


def _pad(values, guard, train, fill, edge):
    """Pad the map by the window: Doppler wraps around, range continues as `edge` says.

    Where no cells exist, it continues with `fill`.
    """
    doppler, range_ = (g + t for g, t in zip(guard, train, strict=True))
    if doppler:
        ends = values[..., -doppler:, :], values[..., :doppler, :]
        values = jnp.concatenate([ends[0], values, ends[1]], -2)
    sides = [(0, 0)] * (values.ndim - 1) + [(range_, range_)]
    if edge in ("wrap", "reflect"):
        return jnp.pad(values, sides, mode=edge)
    return jnp.pad(values, sides, constant_values=fill)


def _sliding_sum(values, size, axis) -> Any:
    """Sums over `size` neighbours by doubling; shortens the axis by size - 1."""
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


def _sums_of_halves(power, guard, train, edge):
    """Sums over the training cells at lower range and over those at higher range.

    Sums columns first, then along range. `whole` are complete columns of the window,
    `beyond` the parts of columns outside the guard cells.
    """
    (gd, gr), (td, tr) = guard, train
    doppler, bins = power.shape[-2:]
    padded = _pad(power, guard, train, 0.0, edge)
    inner = padded[..., td : padded.shape[-2] - td, :]
    whole, own = _sliding_sum(inner, 2 * gd + 1, -2), gr + tr
    halves: list[Any] = [0.0, 0.0]
    if td:
        strip = _sliding_sum(padded, td, -2)
        ends = [
            strip[..., start : start + doppler, :] for start in (0, 2 * gd + td + 1)
        ]
        beyond = ends[0] + ends[1]
        whole = whole + beyond
        halves = [end[..., own : own + bins] for end in ends]
        if gr:
            guarded = _sliding_sum(beyond, gr, -1)
            halves[0] += guarded[..., tr : tr + bins]
            halves[1] += guarded[..., own + 1 : own + 1 + bins]
    if tr:
        strip = _sliding_sum(whole, tr, -1)
        right = 2 * gr + tr + 1
        halves[0] += strip[..., :bins]
        halves[1] += strip[..., right : right + bins]
    return halves


def _count_below(level, padded, guard, train, counted=None):
    """Number of training cells below `level`, counted a few window rows at a time.

    `counted` tells for each range bin whether its low and its high half count.
    """
    (gd, gr), (td, tr) = guard, train
    doppler, bins = level.shape[-2:]
    own = gr + tr
    width = 2 * own + 1
    sides = [*range(tr), *range(width - tr, width)]
    # The barrier keeps XLA from computing the padding again for every row.
    padded = jax.lax.optimization_barrier(padded)

    def count(rows, columns, total):
        """Add the cells of these rows and columns of the window."""
        at_once = max(1, MAX_COMPARISONS // max(len(columns), 1))
        groups, rest = divmod(len(rows), at_once)
        starts = jnp.asarray(rows[: groups * at_once]).reshape(groups, at_once)

        def add_row(start, total):
            row = jax.lax.dynamic_slice_in_dim(padded, start, doppler, axis=-2)
            for column in columns:
                below = row[..., column : column + bins] < level
                if counted is not None:
                    low = (column < own) | ((column == own) & (start < td))
                    below &= jnp.where(low, *counted)
                total += below
            return total

        def add_group(i, total):
            for j in range(at_once):
                total = add_row(starts[i, j], total)
            return total

        if groups:
            total = jax.lax.fori_loop(0, groups, add_group, total)
        for row in rows[len(rows) - rest :]:
            total = add_row(row, total)
        return total

    beyond = [*range(td), *range(2 * gd + td + 1, 2 * (gd + td) + 1)]
    beside = [*range(td, 2 * gd + td + 1)] if tr else []
    total = jnp.zeros(level.shape, jnp.int32)
    for rows, columns in ((beyond, range(width)), (beside, sides)):
        total = count(rows, columns, total) if rows else total
    return total
