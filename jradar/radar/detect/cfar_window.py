"""The cells in the window of a CFAR detector: their sums and their counts.

The window of a cell, its halves and the rules at the ends of the range axis are drawn
in `cfar`.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Num

from jradar.options.detectors import Window
from jradar.radar.ranks import to_rank

Map = Float[Array, "*batch doppler range"]

MAX_COMPARISONS = 96  # in one fused kernel: XLA stops vectorising beyond about 100


def inside(bins: int, window: Window) -> np.ndarray:
    """Whether the whole window of a range bin exists; host."""
    number = np.arange(bins)
    return np.minimum(number, number[::-1]) >= window.sides[1]


def halves_counted(low: np.ndarray, high: np.ndarray, power: Map) -> list[Array]:
    """Which halves count in each range bin."""
    return [to_rank(cells > 0, power) for cells in (low, high)]


def cells_per_range_bin(
    shape: tuple[int, ...], window: Window
) -> tuple[np.ndarray, np.ndarray]:
    """Number of training cells of each range bin in the two halves; host."""
    guard, train, edge = window
    for axis, bins, g, t in zip(
        ("Doppler", "range"), shape[-2:], guard, train, strict=True
    ):
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

    def half(exist):
        columns, guarded = (np.minimum(exist, n) for n in (gr + tr, gr))
        return (2 * (gd + td) + 1) * columns - (2 * gd + 1) * guarded + td

    if edge == "shrink":
        return half(before), half(before[::-1])
    whole = half(np.full(len(before), gr + tr))
    if edge != "one_sided":
        return whole, whole
    low = np.where(before >= gr + tr, whole, 0)
    return low, low[::-1]


def pad(values: Array, window: Window, fill: int | float) -> Array:
    """Pad the map by the window: Doppler wraps around, range continues by the rule.

    Where no cells exist, it continues with `fill`.
    """
    doppler, range_ = window.sides
    if doppler:
        ends = values[..., -doppler:, :], values[..., :doppler, :]
        values = jnp.concatenate([ends[0], values, ends[1]], -2)
    sides = [(0, 0)] * (values.ndim - 1) + [(range_, range_)]
    if window.edge in ("wrap", "reflect"):
        return jnp.pad(values, sides, mode=window.edge)
    return jnp.pad(values, sides, constant_values=fill)


def sums_of_halves(power: Map, window: Window) -> list[Any]:
    """Sums over the training cells at lower range and over those at higher range.

    Sums columns first, then along range. `whole` are complete columns of the window,
    `beyond` the parts of columns outside the guard cells.
    """
    (gd, gr), (td, tr), _ = window
    doppler, bins = power.shape[-2:]
    padded = pad(power, window, 0.0)
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


def count_below(
    level: Num[Array, "*batch doppler range"],
    padded: Array,
    window: Window,
    counted: list[Array] | None,
) -> Int[Array, "*batch doppler range"]:
    """Number of training cells below `level`, counted a few window rows at a time.

    `counted` says for each range bin whether its low and its high half count; if it is
    None, both always do.
    """
    (gd, gr), (td, tr), _ = window
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
