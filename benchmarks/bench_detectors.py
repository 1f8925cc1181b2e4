"""How fast are the CFAR detectors, compared with SciPy and NumPy?

Before a peer is timed, its result must equal ours. Peers wrap around the range axis,
where our windows end, so results are compared away from its ends.
"""

import functools
from collections.abc import Iterator

import jax.numpy as jnp
import numpy as np
from scipy import ndimage

from benchmarks.harness import Call, Case
from jradar.radar import ca_cfar, go_cfar, noise_floor, os_cfar, so_cfar
from jradar.radar.detect.multipliers import false_alarm_multiplier

RATE = 1e-3
MEAN_DETECTORS = {"CA": ca_cfar, "GO": go_cfar, "SO": so_cfar}
COMBINE = {"CA": "add", "GO": "maximum", "SO": "minimum"}  # the halves of a window
# Guard and training cells in (doppler, range).
LINE = {"guard": (0, 4), "train": (0, 8)}
SQUARE = {"guard": (1, 1), "train": (7, 7)}
MARGIN = 12  # range bins at either end that are not compared
FRAMES = 32  # maps in one call


def cases() -> Iterator[Case]:
    """Yield masks and noise floors on a single-chip map, and masks on many."""
    power = np.random.default_rng(0).exponential(size=(FRAMES, 128, 128))
    power = power.astype(np.float32)
    for size, options, peer_of in (
        ("1-D, 16 cells", LINE, _mean_on_line),
        ("2-D, 280 cells", SQUARE, _mean_in_square),
    ):
        for name in MEAN_DETECTORS:
            yield _means(power[0], name, size, options, peer_of)
        yield from _ordered(power[0], size, options)
        for name in MEAN_DETECTORS:
            many = f"{size}, {FRAMES} maps"
            yield _means(power, name, many, options, peer_of)


def _means(power, name, size, options, peer_of):
    """The mask of a detector that compares with means."""
    mask = functools.partial(
        MEAN_DETECTORS[name], jnp.asarray(power), false_alarm_rate=RATE, **options
    )
    peer = dict([peer_of(power, name)])
    return Case(f"{name} mask, {size}", mask, peer, same=_same_inside)


def _same_inside(ours, peer):
    """Return whether masks or floors agree away from the ends of the range axis."""
    ours, peer = (np.asarray(x)[..., MARGIN:-MARGIN] for x in (ours, peer))
    return ours.shape == peer.shape and np.allclose(ours, peer, rtol=1e-4)


def _mean_on_line(power, name) -> tuple[str, Call]:
    """The peer for masks along range, with 8 training and 4 guard cells on a side."""
    alpha = false_alarm_multiplier(name.lower(), RATE, (8, 8))
    scale = alpha / 2 if name == "CA" else alpha
    combine = getattr(np, COMBINE[name])

    def run():
        mean = ndimage.uniform_filter1d(power, 8, axis=-1, mode="wrap")
        return power > scale * combine(np.roll(mean, 8, -1), np.roll(mean, -9, -1))

    return "SciPy uniform_filter1d", run


def _mean_in_square(power, name) -> tuple[str, Call]:
    """The peer for masks from means of 17 x 17 cells without the inner 3 x 3."""
    alpha = false_alarm_multiplier(name.lower(), RATE, (140, 140))

    single = (1,) * (power.ndim - 2)  # the axis of maps

    def ca():
        outer = ndimage.uniform_filter(power, (*single, 17, 17), mode="wrap") * 289
        inner = ndimage.uniform_filter(power, (*single, 3, 3), mode="wrap") * 9
        return power > alpha / 280 * (outer - inner)

    def halves():
        # A half: the columns on one side of the cell, and half of the cell's column.
        outer = ndimage.uniform_filter(power, (*single, 17, 8), mode="wrap") * 136
        inner = ndimage.uniform_filter1d(power, 3, axis=-2, mode="wrap") * 3
        own = ndimage.uniform_filter1d(power, 7, axis=-2, mode="wrap") * 7
        low = np.roll(outer, 4, -1) - np.roll(inner, 1, -1) + np.roll(own, 5, -2)
        high = np.roll(outer, -5, -1) - np.roll(inner, -1, -1) + np.roll(own, -5, -2)
        return power > alpha / 140 * getattr(np, COMBINE[name])(low, high)

    return "SciPy uniform_filter", ca if name == "CA" else halves


def footprint(guard, train):
    """Return the training cells as a footprint for SciPy's ndimage."""
    cells = np.ones([2 * (g + t) + 1 for g, t in zip(guard, train, strict=True)], bool)
    hole = [slice(t, t + 2 * g + 1) for g, t in zip(guard, train, strict=True)]
    cells[tuple(hole)] = False
    return cells


def _ordered(power, size, options):
    """Mask and floor of the ordered statistic, which peers select for every cell."""
    on_device = jnp.asarray(power)
    cells = footprint(**options)
    k = int(np.ceil(0.75 * cells.sum()))
    alpha = false_alarm_multiplier("os", RATE, int(cells.sum()), rank=k)
    half = [n // 2 for n in cells.shape]

    def scipy_rank():
        return ndimage.rank_filter(power, k - 1, footprint=cells, mode="wrap")

    def partition():
        padded = np.pad(power, [(n, n) for n in half], mode="wrap")
        windows = np.lib.stride_tricks.sliding_window_view(padded, cells.shape)
        return np.partition(windows[..., cells], k - 1, axis=-1)[..., k - 1]

    floors = {"SciPy rank_filter": scipy_rank, "NumPy partition": partition}
    masks = {
        name: lambda floor=floor: power > alpha * floor()
        for name, floor in floors.items()
    }
    mask = functools.partial(os_cfar, on_device, false_alarm_rate=RATE, **options)
    yield Case(f"OS mask, {size}", mask, masks, same=_same_inside)
    floor = functools.partial(noise_floor, on_device, kind="os", **options)
    yield Case(f"OS floor, {size}", floor, floors, same=_same_inside)
