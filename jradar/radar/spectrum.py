"""Range and Doppler spectra of an ADC cube.

Windows are normalised to a coherent gain of 1: a target of amplitude a, centred in
its bin, peaks at |a|; white noise of power P per sample has power P * gain in a cell,
with `noise_gain` on the host. Complex samples make the whole spectrum positive range.
"""

import functools

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


@functools.partial(
    jax.jit, static_argnames=("range_window", "doppler_window", "remove_static")
)
def range_doppler(
    cube: Complex[Array, "*batch tx rx chirp sample"],
    *,
    range_window: str = "hann",
    doppler_window: str = "hann",
    remove_static: bool = False,
) -> Complex[Array, "*batch virtual doppler range"]:
    """Range FFT over samples and Doppler FFT over chirps, zero velocity in the middle.

    `remove_static` subtracts the mean over chirps, and with it all that stands still.
    """
    *batch, tx, rx, chirps, samples = cube.shape
    if remove_static:
        cube = cube - cube.mean(-2, keepdims=True)
    weight = np.outer(window(doppler_window, chirps), window(range_window, samples))
    spectrum = jnp.fft.fft2(cube * jnp.asarray(weight, jnp.float32))
    spectrum = jnp.fft.fftshift(spectrum, axes=-2)
    return spectrum.reshape(*batch, tx * rx, chirps, samples)


@jax.jit
def power_map(
    range_doppler: Complex[Array, "*batch virtual doppler range"],
) -> Float[Array, "*batch doppler range"]:
    """Power summed over the antennas, without regard to phase."""
    return (range_doppler.real**2 + range_doppler.imag**2).sum(-3)


def doppler_bins(num_chirps: int) -> np.ndarray:
    """Signed bin of each index of the doppler axis, `[doppler]`, on the host."""
    return np.arange(num_chirps) - num_chirps // 2
