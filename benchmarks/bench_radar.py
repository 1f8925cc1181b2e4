"""How long do spectra and detectors take, beside SciPy, NumPy, PyTorch and OpenRadar?

A peer's result must be ours before it is timed. Peers wrap around the range axis where
our windows end, so detectors are compared away from its ends. OpenRadar's ordered
statistic is right without guard cells only, and is compared without.
"""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
import scipy.fft
from scipy import ndimage

from benchmarks.harness import Case, available
from jradar.radar import (
    RadarSpec,
    all_cells,
    ca_cfar,
    direction_sines,
    directions,
    false_alarm_multiplier,
    go_cfar,
    noise_floor,
    os_cfar,
    power_map,
    radar_points,
    range_doppler,
    so_cfar,
    window,
)

RATE = 1e-3
MEAN_DETECTORS = {"CA": ca_cfar, "GO": go_cfar, "SO": so_cfar}
# Guard and training cells in (doppler, range): 16, 16, 72 and 280 training cells.
LINE = {"guard": (0, 4), "train": (0, 8)}
UNGUARDED = {"guard": (0, 0), "train": (0, 8)}
SMALL = {"guard": (1, 1), "train": (3, 3)}
LARGE = {"guard": (1, 1), "train": (7, 7)}
MARGIN = 12  # of range bins whose windows pass an end


def cases() -> Iterator[Case]:
    """Spectra at both radars' sizes, detectors on a single-chip map, a whole frame."""
    for radar in (RadarSpec.awr1843(), RadarSpec.cascade()):
        yield from _spectra(radar)
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
    yield _angles(RadarSpec.awr1843(), 1024, 64, 32)
    yield _angles(RadarSpec.cascade(), 256, 128, 64)
    yield from _frame()


def _random(*shape):
    """Complex noise [*shape], complex64."""
    parts = np.random.default_rng(0).normal(size=(2, *shape)).astype(np.float32)
    return parts[0] + 1j * parts[1]


def _same_power(ours, peer):
    """Whether power maps agree in float32, ours maybe behind its spectra."""
    ours = np.asarray(ours[1] if isinstance(ours, tuple) else ours)
    return np.allclose(ours, peer, rtol=1e-3, atol=1e-5 * ours.max())


def _same_inside(ours, peer):
    """Whether masks or floors agree away from the ends of the range axis."""
    ours, peer = (np.asarray(x)[:, MARGIN:-MARGIN] for x in (ours, peer))
    return ours.shape == peer.shape and np.allclose(ours, peer, rtol=1e-4)


def _spectra(radar):
    """Power map, and spectra with power, against FFTs over the trailing axes."""
    cube = _random(*radar.cube_shape)
    on_device = jnp.asarray(cube)
    weight = np.outer(
        window("hann", radar.num_chirps), window("hann", radar.num_samples)
    )
    weight = weight.astype(np.float32)

    def on_host(fft2):
        def run():
            spectrum = fft2(cube * weight)
            power = (spectrum.real**2 + spectrum.imag**2).sum((0, 1))
            return np.fft.fftshift(power, axes=0)

        return run

    def torch_fft():
        import torch

        data, taper = torch.from_numpy(cube), torch.from_numpy(weight)

        def run():
            spectrum = torch.fft.fft2(data * taper)
            power = (spectrum.real**2 + spectrum.imag**2).sum((0, 1))
            return torch.fft.fftshift(power, dim=0)

        return run

    def openradar():
        from mmwave import dsp

        _, _, chirps, samples = cube.shape

        def run():
            data = (cube * weight).reshape(-1, chirps, samples).swapaxes(0, 1)
            ranges = dsp.range_processing(data)
            _, spectrum = dsp.doppler_processing(
                ranges, interleaved=False, accumulate=False
            )
            power = (spectrum.real**2 + spectrum.imag**2).sum(1).T
            return np.fft.fftshift(power, axes=0)

        return run

    peers = dict(
        available(
            {
                "SciPy, 1 worker": lambda: on_host(scipy.fft.fft2),
                "SciPy, 2 workers": lambda: on_host(
                    lambda x: scipy.fft.fft2(x, workers=2)
                ),
                "NumPy": lambda: on_host(np.fft.fft2),
                "PyTorch": torch_fft,
                "OpenRadar": openradar,
            }
        )
    )
    size = " x ".join(
        map(str, (radar.num_virtual, radar.num_chirps, radar.num_samples))
    )
    yield Case(
        f"power map, {size}", lambda: power_map(on_device), peers, same=_same_power
    )
    yield Case(
        f"spectra and power, {size}",
        lambda: range_doppler(on_device),
        peers,
        same=_same_power,
    )


def _mean_on_line(power, name):
    """Mask along range, 8 cells and 4 guard cells on a side."""
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
    """Mask of 17 x 17 cells less 3 x 3, whole or in halves, by running means."""
    on_device = jnp.asarray(power)
    alpha = false_alarm_multiplier(name.lower(), RATE, (140, 140))

    def ca():
        outer = ndimage.uniform_filter(power, 17, mode="wrap") * 289
        inner = ndimage.uniform_filter(power, 3, mode="wrap") * 9
        return power > alpha / 280 * (outer - inner)

    def halves():
        # A half: the window's columns on one side of the cell, and half of its own.
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


def _footprint(guard, train):
    """Training cells as a footprint of ndimage."""
    cells = np.ones([2 * (g + t) + 1 for g, t in zip(guard, train, strict=True)], bool)
    hole = [slice(t, t + 2 * g + 1) for g, t in zip(guard, train, strict=True)]
    cells[tuple(hole)] = False
    return cells


def _ordered(power, name, options):
    """Mask and floor of the ordered statistic, by selecting among gathered cells."""
    on_device = jnp.asarray(power)
    cells = _footprint(**options)
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
    """The k-th smallest training cell by gathering windows and partitioning them."""
    half = [n // 2 for n in cells.shape]
    padding = [(n, n) for n in half]

    def run():
        padded = np.pad(power, padding, mode="wrap")
        windows = np.lib.stride_tricks.sliding_window_view(padded, cells.shape)
        return np.partition(windows[..., cells], k - 1, axis=-1)[..., k - 1]

    return run


def _openradar_ordered(power):
    """Mask of the ordered statistic, profile by profile in OpenRadar."""
    on_device = jnp.asarray(power)
    alpha = false_alarm_multiplier("os", RATE, 16, rank=12)

    def openradar():
        from mmwave import dsp

        def run():
            floor = [dsp.os_(row, 0, 8, 11)[1] for row in power]
            return power > alpha * np.stack(floor)

        return run

    def partition():
        floor = _partition_peer(power, _footprint(**UNGUARDED), 12)
        return lambda: power > alpha * floor()

    return Case(
        "OS mask, 1-D, 16 cells, no guard",
        lambda: os_cfar(on_device, false_alarm_rate=RATE, **UNGUARDED),
        dict(available({"NumPy partition": partition, "OpenRadar": openradar})),
        same=_same_inside,
    )


def _angles(radar, num_cells, num_azimuth, num_elevation):
    """Directions of detections, against the whole padded spectrum and its maximum."""
    snapshot = _random(num_cells, radar.num_virtual)
    on_device = jnp.asarray(snapshot)
    bins = {"num_azimuth": num_azimuth, "num_elevation": num_elevation}
    column, row = radar.virtual_positions.T
    grid = np.zeros((num_cells, row.max() + 1, column.max() + 1), np.complex64)
    shared = np.zeros(grid.shape[1:], np.float32)
    np.add.at(shared, (row, column), 1)
    np.add.at(grid, (slice(None), row, column), snapshot / shared[row, column])

    def full_spectrum():
        spectrum = scipy.fft.fft2(grid, s=(num_elevation, num_azimuth), workers=1)
        power = spectrum.real**2 + spectrum.imag**2
        return power.reshape(num_cells, -1).argmax(-1)

    def same(ours, peer):
        """Within a bin of azimuth, where the peer's maximum is a direction."""
        u, w = (np.fft.ifftshift(sines) for sines in direction_sines(radar, **bins))
        u, w = u[peer % num_azimuth], w[peer // num_azimuth]
        seen = u**2 + w**2 <= 1
        azimuth, elevation = map(np.asarray, ours)
        gap = np.abs(np.sin(azimuth) * np.cos(elevation) - u)[seen]
        bin_width = 1 / (num_azimuth * radar.spacing_wavelengths)
        return seen.mean() > 0.5 and (gap <= bin_width).mean() > 0.95

    return Case(
        f"angles of {num_cells:,} detections, {radar.name}",
        lambda: directions(on_device, radar, **bins),
        {f"SciPy fft2 to {num_elevation} x {num_azimuth}, argmax": full_spectrum},
        same=same,
    )


def _frame():
    """One single-chip frame from int16 samples to 1,024 points, or to all cells."""
    radar = RadarSpec.awr1843()
    raw = np.random.default_rng(0).integers(-500, 500, (*radar.cube_shape, 2), np.int16)
    on_device = jnp.asarray(raw)

    def from_samples(function):
        def run(raw):
            raw = raw.astype(jnp.float32)
            return function(jax.lax.complex(raw[..., 0], raw[..., 1]), radar)

        return jax.jit(run)

    points = from_samples(lambda *args: radar_points(*args, false_alarm_rate=0.1))
    cells = from_samples(all_cells)

    def spectra(raw=raw):
        cube = raw[..., 0].astype(np.float32) + 1j * raw[..., 1].astype(np.float32)
        spectrum = scipy.fft.fft2(cube, workers=1)
        return (spectrum.real**2 + spectrum.imag**2).sum((0, 1))

    def spectra_and_floor():
        """What SciPy needs for spectra and the ordered floor alone, no angles."""
        footprint = _footprint((2, 2), (4, 4))
        k = int(np.ceil(0.75 * footprint.sum()))
        return ndimage.rank_filter(spectra(), k - 1, footprint=footprint, mode="wrap")

    size = " x ".join(map(str, (radar.num_virtual, *radar.cube_shape[2:])))
    yield Case(
        f"int16 frame to 1,024 points, {size}",
        lambda: points(on_device),
        {"SciPy, without angles": spectra_and_floor},
    )
    yield Case(
        f"int16 frame to the angles of all cells, {size}",
        lambda: cells(on_device),
        {"SciPy, spectra alone": spectra},
    )
