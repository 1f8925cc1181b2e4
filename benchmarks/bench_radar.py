"""How fast are spectra, angles and a frame, compared with SciPy, NumPy and PyTorch?

Before a peer is timed, its result must equal ours.
"""

import functools
from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
import scipy.fft
from scipy import ndimage

from benchmarks.bench_detectors import footprint
from benchmarks.harness import Case, available
from jradar.radar import (
    PointSpec,
    Radar,
    RadarSpec,
    directions,
    power_map,
    radar_points,
    range_doppler,
)
from jradar.radar.angle.spectrum import direction_sines
from jradar.radar.spectrum import window


def cases() -> Iterator[Case]:
    """Yield spectra and angles of both radars, and a whole single-chip frame."""
    for radar in (RadarSpec.awr1843(), RadarSpec.cascade()):
        yield from _spectra(radar)
    yield _angles(RadarSpec.awr1843(), 1024, 64, 32)
    yield _angles(RadarSpec.cascade(), 256, 128, 64)
    for count in (1, 8, 32):
        yield _frames(count)


def _random(*shape):
    parts = np.random.default_rng(0).normal(size=(2, *shape)).astype(np.float32)
    return parts[0] + 1j * parts[1]


def _size(radar):
    return " x ".join(map(str, (radar.num_virtual, *radar.cube_shape[2:])))


def _same_power(ours, peer):
    """Return whether power maps agree in float32; ours may come with spectra."""
    ours = np.asarray(ours[1] if isinstance(ours, tuple) else ours)
    return np.allclose(ours, peer, rtol=1e-3, atol=1e-5 * ours.max())


def _spectra(radar):
    """Power map, and spectra with power, compared with FFTs over the trailing axes."""
    cube = _random(*radar.cube_shape)
    on_device = jnp.asarray(cube)
    tapers = window("hann", radar.num_chirps), window("hann", radar.num_samples)
    weight = np.outer(*tapers).astype(np.float32)

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

    two_workers = functools.partial(scipy.fft.fft2, workers=2)
    peers = available(
        {
            "SciPy, 1 worker": lambda: on_host(scipy.fft.fft2),
            "SciPy, 2 workers": lambda: on_host(two_workers),
            "NumPy": lambda: on_host(np.fft.fft2),
            "PyTorch": torch_fft,
        }
    )
    for name, ours in (("power map", power_map), ("spectra and power", range_doppler)):
        call = functools.partial(ours, on_device)
        yield Case(f"{name}, {_size(radar)}", call, peers, same=_same_power)


def _angles(radar, num_cells, num_azimuth, num_elevation):
    """Directions of detections, compared with the maximum of the padded spectrum."""
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
        """Return whether azimuths agree within a bin, where the peer's is visible."""
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


def _frames(count):
    """Single-chip frames from int16 samples to 1,024 points, in one call by `vmap`."""
    radar = RadarSpec.awr1843()
    shape = count, *radar.cube_shape, 2
    frames = np.random.default_rng(0).integers(-500, 500, shape, np.int16)
    on_device = jnp.asarray(frames)
    spec = PointSpec(false_alarm_rate=0.1)

    @jax.jit
    @jax.vmap
    def points(raw):
        raw = raw.astype(jnp.float32)
        return radar_points(
            jax.lax.complex(raw[..., 0], raw[..., 1]), Radar(radar), points=spec
        )

    def spectra_and_floor(raw):
        """Spectra and the ordered floor by SciPy, without angles."""
        cube = raw[..., 0].astype(np.float32) + 1j * raw[..., 1].astype(np.float32)
        spectrum = scipy.fft.fft2(cube, workers=1)
        power = (spectrum.real**2 + spectrum.imag**2).sum((0, 1))
        cells = footprint(spec.guard, spec.train)
        k = int(np.ceil(0.75 * cells.sum()))
        return ndimage.rank_filter(power, k - 1, footprint=cells, mode="wrap")

    many = "int16 frame" if count == 1 else f"{count} int16 frames"
    return Case(
        f"{many} to 1,024 points, {_size(radar)}",
        lambda: points(on_device),
        {"SciPy, without angles": lambda: [spectra_and_floor(raw) for raw in frames]},
    )
