"""Range and Doppler spectra of an ADC cube.

Windows are normalised to a coherent gain of 1: a target of amplitude a, centred in
its bin, peaks at |a|; white noise of power P per sample has power P * gain in a cell,
with `noise_gain` on the host. Complex samples make the whole spectrum positive range.

Antennas are transformed one after the other, so that a spectrum is still in the cache
when its power is added up. Zero velocity gets to the middle of the Doppler axis by
alternating the signs of the chirps, which costs nothing.
"""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

WINDOWS = {  # coefficients of the cosine series, periodic
    "none": (1.0,),
    "hann": (0.5, 0.5),
    "hamming": (0.54, 0.46),
    "blackman": (0.42, 0.5, 0.08),
}
STATIC = ("range_window", "doppler_window", "remove_static", "max_range_bins")

Cube = Complex[Array, "*batch tx rx chirp sample"]
Spectrum = Complex[Array, "*batch virtual doppler range"]
PowerMap = Float[Array, "*batch doppler range"]


@functools.cache
def window(kind: str, length: int) -> np.ndarray:
    """Periodic window of `length` samples whose sum is 1, on the host in float64."""
    if kind not in WINDOWS:
        raise ValueError(f"window {kind!r}, expected one of {[*WINDOWS]}")
    phase = 2 * np.pi * np.arange(length) / length
    terms = [(-1) ** k * a * np.cos(k * phase) for k, a in enumerate(WINDOWS[kind])]
    values = np.sum(terms, axis=0)
    if not values.any():  # one sample leaves a periodic window nothing
        values = np.ones(length)
    return values / values.sum()


def noise_gain(kind: str, length: int) -> float:
    """Power of white noise in a windowed cell over its power in a sample."""
    return float((window(kind, length) ** 2).sum())


@functools.partial(jax.jit, static_argnames=STATIC)
def range_doppler(
    cube: Cube,
    *,
    range_window: str = "hann",
    doppler_window: str = "hann",
    remove_static: bool = False,
    max_range_bins: int | None = None,
) -> tuple[Spectrum, PowerMap]:
    """Spectra over samples and chirps, and their power summed over the antennas.

    Zero velocity is in the middle of the doppler axis. `remove_static` subtracts the
    mean over chirps, and with it all that stands still; `max_range_bins` drops the far
    end of the range axis. Raises ValueError for an unknown window.
    """
    windows = range_window, doppler_window
    return _transform(cube, windows, remove_static, max_range_bins, keep=True)


@functools.partial(jax.jit, static_argnames=STATIC)
def power_map(
    cube: Cube,
    *,
    range_window: str = "hann",
    doppler_window: str = "hann",
    remove_static: bool = False,
    max_range_bins: int | None = None,
) -> PowerMap:
    """The power of `range_doppler` alone; the spectra are never stored."""
    windows = range_window, doppler_window
    return _transform(cube, windows, remove_static, max_range_bins, keep=False)[1]


def doppler_bins(num_chirps: int) -> np.ndarray:
    """Signed bin of each index of the doppler axis, `[doppler]`, on the host."""
    return np.arange(num_chirps) - num_chirps // 2


def _transform(cube, windows, remove_static, max_range_bins, keep) -> Any:
    """Spectra, if they are kept, and power, antenna by antenna."""
    *batch, tx, rx, chirps, samples = cube.shape
    bins = samples if max_range_bins is None else max_range_bins
    if not 1 <= bins <= samples:
        raise ValueError(f"{max_range_bins=}, expected 1 to {samples}")
    weight = np.outer(window(windows[1], chirps), window(windows[0], samples))
    if chirps % 2 == 0:
        weight *= (-1.0) ** np.arange(chirps)[:, None]
    weight = jnp.asarray(weight, cube.real.dtype)

    def add(power, antenna):
        if remove_static:
            antenna = antenna - antenna.mean(-2, keepdims=True)
        weighted = jax.lax.complex(antenna.real * weight, antenna.imag * weight)
        spectrum = jnp.fft.fft2(weighted)[..., :bins]
        power += spectrum.real**2 + spectrum.imag**2
        return power, spectrum if keep else None

    antennas = jnp.moveaxis(cube.reshape(*batch, tx * rx, chirps, samples), -3, 0)
    start = jnp.zeros((*batch, chirps, bins), cube.real.dtype)
    power, spectrum = jax.lax.scan(add, start, antennas)
    if spectrum is not None:
        spectrum = jnp.moveaxis(spectrum, 0, -3)
    if chirps % 2:
        shift = functools.partial(jnp.fft.fftshift, axes=-2)
        spectrum, power = jax.tree.map(shift, (spectrum, power))
    return spectrum, power
