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

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Num

from jradar.radar.detect.cfar_window import (
    GUARD,
    TRAIN,
    cell_pair,
    cells_per_range_bin,
    check_edge,
    count_below,
    halves_counted,
    inside,
    pad,
    sums_of_halves,
)
from jradar.radar.detect.correlation import independent_cells
from jradar.radar.detect.multipliers import KINDS, false_alarm_multiplier
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
    low, high = cells_per_range_bin(power.shape, guard, train, edge)
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
        padded = pad(power, guard, train, jnp.inf, edge)
        counted = halves_counted(low, high, power) if edge == "one_sided" else None
        count = count_below(level, padded, guard, train, counted)
        mask = count >= to_rank(_rank(low + high), power)
    if edge == "fill":
        ends, floor = _filled_ends(kind, power, guard, train)
        above = power[..., ends] > multiplier[..., ends] * floor
        return mask.at[..., ends].set(above)
    if edge == "skip":
        return mask & to_rank(inside(shape[1], guard, train), power)
    return mask


def _detector(kind: str, summary: str):
    """Return the detector of a kind, with the options of `cfar`."""

    def detector(
        power: Power,
        *,
        false_alarm_rate: float | None = None,
        channels: int = 1,
        guard: tuple[int, int] = GUARD,
        train: tuple[int, int] = TRAIN,
        windows: tuple[str, str] = NO_WINDOWS,
        edge: str = "shrink",
        factor: float | None = None,
    ) -> Mask:
        return cfar(
            power,
            kind=kind,
            false_alarm_rate=false_alarm_rate,
            channels=channels,
            guard=guard,
            train=train,
            windows=windows,
            edge=edge,
            factor=factor,
        )

    detector.__name__ = detector.__qualname__ = f"{kind}_cfar"
    detector.__doc__ = f"{summary}\n\nThe options and errors are those of `cfar`."
    return detector


ca_cfar = _detector(
    "ca", "Cell averaging: marks cells above the mean of all training cells."
)
go_cfar = _detector(
    "go",
    "Greatest of: marks cells above the greater of the means of two halves. It gives\n"
    "fewer false alarms where clutter begins.",
)
so_cfar = _detector(
    "so",
    "Smallest of: marks cells above the smaller of the means of two halves. It finds\n"
    "targets next to other targets.",
)
os_cfar = _detector(
    "os",
    "Ordered statistic: marks cells above the training cell at three quarters of the\n"
    "rank.",
)
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
    low, high = cells_per_range_bin(power.shape, guard, train, edge)
    ranks = to_rank(_rank(low + high), power)
    keys = jax.lax.bitcast_convert_type(power.astype(jnp.float32), jnp.int32)
    padded = pad(keys, guard, train, jnp.iinfo(jnp.int32).max, edge)
    counted = halves_counted(low, high, power) if edge == "one_sided" else None

    def refine(i, found):
        """Set the next lower bit where fewer than k cells lie below the result."""
        candidate = found | (jnp.int32(1) << (30 - i))
        fewer = count_below(candidate, padded, guard, train, counted) < ranks
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


def _filled_ends(kind, power, guard, train):
    """Range bins at the ends, and their floor from the nearest 2 * train cells."""
    bins, cells = power.shape[-1], 2 * train[1]
    ends = np.flatnonzero(~inside(bins, guard, train))
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
    low, high = cells_per_range_bin(power.shape, guard, train, edge)
    sums = sums_of_halves(power, guard, train, edge)
    if edge == "one_sided":
        sums = [
            jnp.where(counts, half, 0)
            for counts, half in zip(halves_counted(low, high, power), sums, strict=True)
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


@functools.lru_cache(256)
def _multipliers(kind, rate, channels, shape, guard, train, windows, edge):
    """Multiplier of each range bin; host."""
    low, high = cells_per_range_bin(shape, guard, train, edge)
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
