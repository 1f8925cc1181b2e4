"""How fast are the CFAR detectors, compared with SciPy, NumPy, PyTorch and OpenRadar?

Before a peer is timed, its result must equal ours. Peers wrap around the range axis,
where our windows end, so results are compared away from its ends. OpenRadar's ordered
statistic is only correct without guard cells.
"""

import functools
from collections.abc import Iterator

import jax.numpy as jnp
import numpy as np
from scipy import ndimage

from benchmarks.harness import Case, available
from jradar.radar import (
    ca_cfar,
    false_alarm_multiplier,
    go_cfar,
    noise_floor,
    os_cfar,
    so_cfar,
)

RATE = 1e-3
MEAN_DETECTORS = {"CA": ca_cfar, "GO": go_cfar, "SO": so_cfar}
COMBINE = {"CA": "add", "GO": "maximum", "SO": "minimum"}  # the halves of a window
# Guard and training cells in (doppler, range): 16, 16, 72 and 280 training cells.
LINE = {"guard": (0, 4), "train": (0, 8)}
UNGUARDED = {"guard": (0, 0), "train": (0, 8)}
SMALL = {"guard": (1, 1), "train": (3, 3)}
LARGE = {"guard": (1, 1), "train": (7, 7)}
MARGIN = 12  # range bins at either end that are not compared


def cases() -> Iterator[Case]:
    """Yield masks and noise floors on a single-chip map."""
    power = np.random.default_rng(0).exponential(size=(128, 128)).astype(np.float32)
    on_device = jnp.asarray(power)
    for size, options, peers_of in (
        ("1-D, 16 cells", LINE, _means_on_line),
        ("2-D, 280 cells", LARGE, _means_in_square),
    ):
        for name, detector in MEAN_DETECTORS.items():
            mask = functools.partial(detector, on_device, false_alarm_rate=RATE)
            mask = functools.partial(mask, **options)
            peers = available(peers_of(power, name))
            yield Case(f"{name} mask, {size}", mask, peers, same=_same_inside)
    for size, options in (
        ("1-D, 16 cells", LINE),
        ("2-D, 72 cells", SMALL),
        ("2-D, 280 cells", LARGE),
        ("1-D, 16 cells, no guard", UNGUARDED),
    ):
        yield from _ordered(power, size, options)


def _same_inside(ours, peer):
    """Return whether masks or floors agree away from the ends of the range axis."""
    ours, peer = (np.asarray(x)[:, MARGIN:-MARGIN] for x in (ours, peer))
    return ours.shape == peer.shape and np.allclose(ours, peer, rtol=1e-4)


def _means_on_line(power, name):
    """Peers for masks along range, with 8 training and 4 guard cells on a side."""
    alpha = false_alarm_multiplier(name.lower(), RATE, (8, 8))
    scale = alpha / 2 if name == "CA" else alpha

    def scipy_filter():
        combine = getattr(np, COMBINE[name])

        def run():
            mean = ndimage.uniform_filter1d(power, 8, axis=1, mode="wrap")
            return power > scale * combine(np.roll(mean, 8, 1), np.roll(mean, -9, 1))

        return run

    def torch_pool():
        import torch

        data, combine = torch.from_numpy(power), getattr(torch, COMBINE[name])

        def run():
            padded = torch.nn.functional.pad(data[None], (12, 12), mode="circular")
            mean = torch.nn.functional.avg_pool1d(padded, 8, stride=1)[0]
            return data > scale * combine(mean[:, :128], mean[:, 17:145])

        return run

    def openradar():
        from mmwave import dsp

        floor = {"CA": dsp.ca_, "GO": dsp.cago_, "SO": dsp.caso_}[name]
        return lambda: power > alpha * floor(power, 4, 8, "wrap", 0)[1]

    return {
        "SciPy uniform_filter1d": scipy_filter,
        "PyTorch avg_pool1d": torch_pool,
        "OpenRadar": openradar,
    }


def _means_in_square(power, name):
    """Peers for masks from means of 17 x 17 cells without the inner 3 x 3."""
    alpha = false_alarm_multiplier(name.lower(), RATE, (140, 140))

    def ca():
        outer = ndimage.uniform_filter(power, 17, mode="wrap") * 289
        inner = ndimage.uniform_filter(power, 3, mode="wrap") * 9
        return power > alpha / 280 * (outer - inner)

    def halves():
        # A half: the columns on one side of the cell, and half of the cell's column.
        outer = ndimage.uniform_filter(power, (17, 8), mode="wrap") * 136
        inner = ndimage.uniform_filter1d(power, 3, axis=0, mode="wrap") * 3
        own = ndimage.uniform_filter1d(power, 7, axis=0, mode="wrap") * 7
        low = np.roll(outer, 4, 1) - np.roll(inner, 1, 1) + np.roll(own, 5, 0)
        high = np.roll(outer, -5, 1) - np.roll(inner, -1, 1) + np.roll(own, -5, 0)
        return power > alpha / 140 * getattr(np, COMBINE[name])(low, high)

    def torch_pool():
        import torch
        from torch.nn import functional

        data, pool = torch.from_numpy(power), functional.avg_pool2d
        combine = getattr(torch, COMBINE[name])

        def ca():
            padded = functional.pad(data[None, None], (8, 8, 8, 8), mode="circular")
            outer = pool(padded, 17, stride=1) * 289
            inner = pool(padded[..., 7:-7, 7:-7], 3, stride=1) * 9
            return data > alpha / 280 * (outer - inner)[0, 0]

        def halves():
            padded = functional.pad(data[None, None], (8, 8, 8, 8), mode="circular")
            outer = pool(padded, (17, 8), stride=1) * 136
            inner = pool(padded[..., 7:-7, :], (3, 1), stride=1) * 3
            own = pool(padded[..., 8:-8], (7, 1), stride=1) * 7
            low = outer[..., :128] - inner[..., 7:135] + own[..., :128, :]
            high = outer[..., 9:] - inner[..., 9:137] + own[..., 10:, :]
            return data > alpha / 140 * combine(low, high)[0, 0]

        return ca if name == "CA" else halves

    return {
        "SciPy uniform_filter": lambda: ca if name == "CA" else halves,
        "PyTorch avg_pool2d": torch_pool,
    }


def footprint(guard, train):
    """Return the training cells as a footprint for SciPy's ndimage."""
    cells = np.ones([2 * (g + t) + 1 for g, t in zip(guard, train, strict=True)], bool)
    hole = [slice(t, t + 2 * g + 1) for g, t in zip(guard, train, strict=True)]
    cells[tuple(hole)] = False
    return cells


def _ordered(power, size, options):
    """Mask and floor of the ordered statistic; most peers select in gathered cells."""
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

    def torch_kth():
        import torch

        data, training = torch.from_numpy(power), torch.from_numpy(cells)
        padding = dict(pad=(half[1], half[1], half[0], half[0]), mode="circular")

        def run():
            padded = torch.nn.functional.pad(data[None, None], **padding)[0, 0]
            windows = padded.unfold(0, cells.shape[0], 1).unfold(1, cells.shape[1], 1)
            return windows[..., training].kthvalue(k).values

        return run

    def openradar():
        from mmwave import dsp

        return lambda: np.stack([dsp.os_(row, 0, 8, k - 1)[1] for row in power])

    makers = {
        "SciPy rank_filter": lambda: scipy_rank,
        "NumPy partition": lambda: partition,
        "PyTorch kthvalue": torch_kth,
    }
    if not any(options["guard"]):
        makers["OpenRadar"] = openradar
    floors = available(makers)
    masks = {
        name: lambda floor=floor: power > alpha * np.asarray(floor())
        for name, floor in floors.items()
    }
    mask = functools.partial(os_cfar, on_device, false_alarm_rate=RATE, **options)
    yield Case(f"OS mask, {size}", mask, masks, same=_same_inside)
    floor = functools.partial(noise_floor, on_device, kind="os", **options)
    yield Case(f"OS floor, {size}", floor, floors, same=_same_inside)
