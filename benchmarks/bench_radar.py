"""How long do spectra and detectors take, beside SciPy, NumPy and PyTorch?"""

from collections.abc import Callable, Iterator

import jax
import jax.numpy as jnp
import numpy as np
import scipy.fft
from scipy import ndimage

from benchmarks.harness import Case, available
from jradar.radar import (
    RadarSpec,
    ca_cfar,
    directions,
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
# Guard and training cells in (doppler, range): 16, 72 and 280 training cells.
LINE = {"guard": (0, 4), "train": (0, 8)}
SMALL = {"guard": (1, 1), "train": (3, 3)}
LARGE = {"guard": (1, 1), "train": (7, 7)}


def cases() -> Iterator[Case]:
    """Spectra at both radars' sizes, detectors on a single-chip map, a whole frame."""
    for radar in (RadarSpec.awr1843(), RadarSpec.cascade()):
        yield from _spectra(radar)
    yield from _detectors()
    yield _angles(RadarSpec.awr1843(), 1024, 64, 32)
    yield _angles(RadarSpec.cascade(), 256, 128, 64)
    yield _frame()


def _random(*shape):
    """Complex noise [*shape], complex64."""
    parts = np.random.default_rng(0).normal(size=(2, *shape)).astype(np.float32)
    return parts[0] + 1j * parts[1]


def _spectra(radar):
    """Power map, and spectra with power, against FFTs over the trailing axes."""
    cube = _random(*radar.cube_shape)
    on_device = jnp.asarray(cube)
    weight = np.outer(
        window("hann", radar.num_chirps), window("hann", radar.num_samples)
    )
    weight = weight.astype(np.float32)

    def scipy_fft(workers: int) -> Callable[[], Callable]:
        def run():
            spectrum = scipy.fft.fft2(cube * weight, workers=workers)
            power = (spectrum.real**2 + spectrum.imag**2).sum((0, 1))
            return np.fft.fftshift(power, axes=0)

        return lambda: run

    def numpy_fft():
        def run():
            spectrum = np.fft.fft2(cube * weight)
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

    peers = dict(
        available(
            {
                "SciPy, 1 worker": scipy_fft(1),
                "SciPy, 2 workers": scipy_fft(2),
                "NumPy": numpy_fft,
                "PyTorch": torch_fft,
            }
        )
    )
    size = " x ".join(
        map(str, (radar.num_virtual, radar.num_chirps, radar.num_samples))
    )
    yield Case(f"power map, {size}", lambda: power_map(on_device), peers)
    yield Case(f"spectra and power, {size}", lambda: range_doppler(on_device), peers)


def _footprint(guard, train):
    """Training cells as a footprint of ndimage."""
    cells = np.ones([2 * (g + t) + 1 for g, t in zip(guard, train, strict=True)], bool)
    hole = [slice(t, t + 2 * g + 1) for g, t in zip(guard, train, strict=True)]
    cells[tuple(hole)] = False
    return cells


def _detectors():
    """Masks and floors of a 128 x 128 map."""
    power = np.random.default_rng(0).exponential(size=(128, 128)).astype(np.float32)
    on_device = jnp.asarray(power)
    for name, detector in (("CA", ca_cfar), ("GO", go_cfar), ("SO", so_cfar)):
        yield Case(
            f"{name} mask, 2-D, 280 cells",
            lambda d=detector: d(on_device, false_alarm_rate=RATE, **LARGE),
            {"SciPy uniform_filter": _box_peer(power, name)},
        )
    for name, options in (
        ("1-D, 16 cells", LINE),
        ("2-D, 72 cells", SMALL),
        ("2-D, 280 cells", LARGE),
    ):
        cells = _footprint(**options)
        k = int(np.ceil(0.75 * cells.sum()))
        peers = {
            "SciPy rank_filter": lambda c=cells, k=k: ndimage.rank_filter(
                power, k - 1, footprint=c, mode="wrap"
            ),
            "NumPy partition": _partition_peer(power, cells, k),
        }
        yield Case(
            f"OS mask, {name}",
            lambda o=options: os_cfar(on_device, false_alarm_rate=RATE, **o),
            peers,
        )
        yield Case(
            f"OS floor, {name}",
            lambda o=options: noise_floor(on_device, kind="os", **o),
            peers,
        )


def _box_peer(power, name):
    """Mask by running means: the window less the guard, or two halves of it."""

    def ca():
        outer = ndimage.uniform_filter(power, 17, mode="wrap") * 289
        inner = ndimage.uniform_filter(power, 3, mode="wrap") * 9
        return power > 7 / 280 * (outer - inner)

    def halves():
        # A half is the window's columns on one side of the cell.
        outer = ndimage.uniform_filter(power, (17, 8), mode="wrap") * 136
        inner = ndimage.uniform_filter(power, (3, 1), mode="wrap") * 3
        low = np.roll(outer, 4, 1) - np.roll(inner, 1, 1)
        high = np.roll(outer, -5, 1) - np.roll(inner, -1, 1)
        pick = np.maximum if name == "GO" else np.minimum
        return power > 7 / 133 * pick(low, high)

    return ca if name == "CA" else halves


def _partition_peer(power, cells, k):
    """The k-th smallest training cell by gathering windows and partitioning them."""
    half = [n // 2 for n in cells.shape]
    padded = np.pad(power, [(n, n) for n in half], mode="wrap")
    windows = np.lib.stride_tricks.sliding_window_view(padded, cells.shape)

    def run():
        return np.partition(windows[..., cells], k - 1, axis=-1)[..., k - 1]

    return run


def _angles(radar, num_cells, num_azimuth, num_elevation):
    """Directions of detections, against the whole padded spectrum and its maximum."""
    snapshot = _random(num_cells, radar.num_virtual)
    on_device = jnp.asarray(snapshot)
    column, row = radar.virtual_positions.T
    grid = np.zeros((num_cells, row.max() + 1, column.max() + 1), np.complex64)
    np.add.at(grid, (slice(None), row, column), snapshot)

    def full_spectrum():
        spectrum = scipy.fft.fft2(grid, s=(num_elevation, num_azimuth), workers=1)
        power = spectrum.real**2 + spectrum.imag**2
        return power.reshape(num_cells, -1).argmax(-1)

    return Case(
        f"angles of {num_cells:,} detections, {radar.name}",
        lambda: directions(
            on_device, radar, num_azimuth=num_azimuth, num_elevation=num_elevation
        ),
        {f"SciPy fft2 to {num_elevation} x {num_azimuth}, argmax": full_spectrum},
    )


def _frame():
    """One single-chip frame from int16 samples to 1,024 points."""
    radar = RadarSpec.awr1843()
    raw = np.random.default_rng(0).integers(-500, 500, (*radar.cube_shape, 2), np.int16)
    on_device = jnp.asarray(raw)

    @jax.jit
    def ours(raw):
        raw = raw.astype(jnp.float32)
        cube = jax.lax.complex(raw[..., 0], raw[..., 1])
        return radar_points(cube, radar, false_alarm_rate=0.1)

    def spectra_and_floor():
        """What SciPy needs for spectra and the ordered floor alone, no angles."""
        cube = raw[..., 0].astype(np.float32) + 1j * raw[..., 1].astype(np.float32)
        spectrum = scipy.fft.fft2(cube, workers=1)
        power = (spectrum.real**2 + spectrum.imag**2).sum((0, 1))
        cells = _footprint((2, 2), (4, 4))
        k = int(np.ceil(0.75 * cells.sum()))
        return ndimage.rank_filter(power, k - 1, footprint=cells, mode="wrap")

    return Case(
        "int16 frame to 1,024 points, 12 x 128 x 128",
        lambda: ours(on_device),
        {"SciPy, without angles": spectra_and_floor},
    )
