"""How fast are the CFAR detectors, compared with SciPy, NumPy, PyTorch and OpenRadar?

Before a peer is timed, its result must equal ours. Peers wrap around the range axis,
where our windows end, so results are compared away from its ends. OpenRadar's ordered
statistic is only correct without guard cells.
"""

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
# Guard and training cells in (doppler, range): 16, 16, 72 and 280 training cells.
LINE = {"guard": (0, 4), "train": (0, 8)}
UNGUARDED = {"guard": (0, 0), "train": (0, 8)}
SMALL = {"guard": (1, 1), "train": (3, 3)}
LARGE = {"guard": (1, 1), "train": (7, 7)}
MARGIN = 12  # range bins at either end that are not compared


def cases() -> Iterator[Case]:
    """Yield masks and noise floors on a single-chip map."""
    power = np.random.default_rng(0).exponential(size=(128, 128)).astype(np.float32)
    for name in MEAN_DETECTORS:
        yield _mean_on_line(power, name)
    for name in MEAN_DETECTORS:
        yield _mean_in_square(power, name)
    for name, options in (
        ("1-D, 16 cells", LINE),
        ("2-D, 72 cells", SMALL),
        ("2-D, 280 cells", LARGE),
    ):
        yield from _ordered(power, name, options)
    yield _openradar_ordered(power)


def _same_inside(ours, peer):
    """Whether masks or floors agree away from the ends of the range axis."""
    ours, peer = (np.asarray(x)[:, MARGIN:-MARGIN] for x in (ours, peer))
    return ours.shape == peer.shape and np.allclose(ours, peer, rtol=1e-4)


def _mean_on_line(power, name):
    """Masks along range, with 8 training and 4 guard cells on a side."""
    on_device = jnp.asarray(power)
    alpha = false_alarm_multiplier(name.lower(), RATE, (8, 8))

    def scipy_filter():
        pick = {"CA": np.add, "GO": np.maximum, "SO": np.minimum}[name]
        scale = alpha / 2 if name == "CA" else alpha

        def run():
            mean = ndimage.uniform_filter1d(power, 8, axis=1, mode="wrap")
            return power > scale * pick(np.roll(mean, 8, 1), np.roll(mean, -9, 1))

        return run

    def torch_pool():
        import torch

        data = torch.from_numpy(power)
        pick = {"CA": torch.add, "GO": torch.maximum, "SO": torch.minimum}[name]
        scale = alpha / 2 if name == "CA" else alpha

        def run():
            padded = torch.nn.functional.pad(data[None], (12, 12), mode="circular")
            mean = torch.nn.functional.avg_pool1d(padded, 8, stride=1)[0]
            return data > scale * pick(mean[:, :128], mean[:, 17:145])

        return run

    def openradar():
        from mmwave import dsp

        floor = {"CA": dsp.ca_, "GO": dsp.cago_, "SO": dsp.caso_}[name]
        return lambda: power > alpha * floor(power, 4, 8, "wrap", 0)[1]

    peers = {
        "SciPy uniform_filter1d": scipy_filter,
        "PyTorch avg_pool1d": torch_pool,
        "OpenRadar": openradar,
    }
    return Case(
        f"{name} mask, 1-D, 16 cells",
        lambda: MEAN_DETECTORS[name](on_device, false_alarm_rate=RATE, **LINE),
        dict(available(peers)),
        same=_same_inside,
    )


def _mean_in_square(power, name):
    """Masks from running means of 17 x 17 cells without the inner 3 x 3."""
    on_device = jnp.asarray(power)
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
        pick = np.maximum if name == "GO" else np.minimum
        return power > alpha / 140 * pick(low, high)

    def torch_pool():
        import torch
        from torch.nn import functional

        data, pool = torch.from_numpy(power), functional.avg_pool2d

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
            pick = torch.maximum if name == "GO" else torch.minimum
            return data > alpha / 140 * pick(low, high)[0, 0]

        return ca if name == "CA" else halves

    peers = {
        "SciPy uniform_filter": lambda: ca if name == "CA" else halves,
        "PyTorch avg_pool2d": torch_pool,
    }
    return Case(
        f"{name} mask, 2-D, 280 cells",
        lambda: MEAN_DETECTORS[name](on_device, false_alarm_rate=RATE, **LARGE),
        dict(available(peers)),
        same=_same_inside,
    )


def footprint(guard, train):
    """Return the training cells as a footprint for SciPy's ndimage."""
    cells = np.ones([2 * (g + t) + 1 for g, t in zip(guard, train, strict=True)], bool)
    hole = [slice(t, t + 2 * g + 1) for g, t in zip(guard, train, strict=True)]
    cells[tuple(hole)] = False
    return cells


def _ordered(power, name, options):
    """Mask and floor of the ordered statistic; peers select among gathered cells."""
    on_device = jnp.asarray(power)
    cells = footprint(**options)
    k = int(np.ceil(0.75 * cells.sum()))
    alpha = false_alarm_multiplier("os", RATE, int(cells.sum()), rank=k)

    def scipy_rank():
        return ndimage.rank_filter(power, k - 1, footprint=cells, mode="wrap")

    def torch_kth():
        import torch

        half = [n // 2 for n in cells.shape for _ in range(2)][::-1]
        data, training = torch.from_numpy(power), torch.from_numpy(cells)
        padding = dict(pad=half, mode="circular")

        def run():
            padded = torch.nn.functional.pad(data[None, None], **padding)[0, 0]
            windows = padded.unfold(0, cells.shape[0], 1).unfold(1, cells.shape[1], 1)
            return windows[..., training].kthvalue(k).values

        return run

    floors = dict(
        available(
            {
                "SciPy rank_filter": lambda: scipy_rank,
                "NumPy partition": lambda: _partition_peer(power, cells, k),
                "PyTorch kthvalue": torch_kth,
            }
        )
    )
    masks = {
        name: lambda floor=floor: power > alpha * np.asarray(floor())
        for name, floor in floors.items()
    }
    yield Case(
        f"OS mask, {name}",
        lambda: os_cfar(on_device, false_alarm_rate=RATE, **options),
        masks,
        same=_same_inside,
    )
    yield Case(
        f"OS floor, {name}",
        lambda: noise_floor(on_device, kind="os", **options),
        floors,
        same=_same_inside,
    )


def _partition_peer(power, cells, k):
    """The k-th smallest training cell by partitioning gathered windows."""
    half = [n // 2 for n in cells.shape]
    padding = [(n, n) for n in half]

    def run():
        padded = np.pad(power, padding, mode="wrap")
        windows = np.lib.stride_tricks.sliding_window_view(padded, cells.shape)
        return np.partition(windows[..., cells], k - 1, axis=-1)[..., k - 1]

    return run


def _openradar_ordered(power):
    """Mask of the ordered statistic; OpenRadar computes profile by profile."""
    on_device = jnp.asarray(power)
    alpha = false_alarm_multiplier("os", RATE, 16, rank=12)

    def openradar():
        from mmwave import dsp

        def run():
            floor = [dsp.os_(row, 0, 8, 11)[1] for row in power]
            return power > alpha * np.stack(floor)

        return run

    def partition():
        floor = _partition_peer(power, footprint(**UNGUARDED), 12)
        return lambda: power > alpha * floor()

    return Case(
        "OS mask, 1-D, 16 cells, no guard",
        lambda: os_cfar(on_device, false_alarm_rate=RATE, **UNGUARDED),
        dict(available({"NumPy partition": partition, "OpenRadar": openradar})),
        same=_same_inside,
    )
