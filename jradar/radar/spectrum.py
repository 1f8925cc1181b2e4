"""Range and Doppler spectra of an ADC cube.

Windows are normalised to a coherent gain of 1: a target of amplitude a in the middle
of its bin peaks at |a|. White noise of power P per sample has power
P * (w ** 2).sum() in a cell, where w is the product of both windows. The whole spectrum
of complex samples is positive range. Of real samples only the first half is returned:
a real target of amplitude a peaks there at |a| / 2.

Integers and half precision are computed in float32; integer pairs, `[..., sample, 2]`,
are I and Q (see `samples`).

Antennas are transformed one after the other, so that each spectrum is still in the
cache when its power is added up. The signs of the chirps alternate, which moves zero
velocity to the middle of the Doppler axis at no cost.
"""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from jradar.compiled import jit
from jradar.options.points import WINDOWS
from jradar.radar.clean.interference import excise_interference
from jradar.radar.samples import Cube, as_samples

STATIC = ("range_window", "doppler_window", "remove_static", "remove_interference")

Spectrum = Complex[Array, "*batch virtual doppler range"]
PowerMap = Float[Array, "*batch doppler range"]


@functools.cache
def window(kind: str, length: int) -> np.ndarray:
    """Return a periodic window whose sum is 1, on the host in float64."""
    if kind not in WINDOWS:
        raise ValueError(f"window {kind!r}, expected one of {[*WINDOWS]}")
    phase = 2 * np.pi * np.arange(length) / length
    terms = [(-1) ** k * a * np.cos(k * phase) for k, a in enumerate(WINDOWS[kind])]
    values = np.sum(terms, axis=0)
    if not values.any():  # a periodic window of one sample is 0
        values = np.ones(length)
    return values / values.sum()


@jit(static_argnames=STATIC)
def range_doppler(
    cube: Cube,
    *,
    range_window: str = "hann",
    doppler_window: str = "hann",
    remove_static: bool = False,
    remove_interference: bool = False,
) -> tuple[Spectrum, PowerMap]:
    """Return spectra over samples and chirps, and their power summed over antennas.

    Zero velocity is in the middle of the doppler axis. `remove_static` subtracts the
    mean over chirps, which removes everything that stands still. `remove_interference`
    excises crossing chirps of other radars. Raises ValueError for an unknown window.
    """
    options = range_window, doppler_window, remove_static, remove_interference
    return _transform(cube, *options, keep=True)


@jit(static_argnames=STATIC)
def power_map(
    cube: Cube,
    *,
    range_window: str = "hann",
    doppler_window: str = "hann",
    remove_static: bool = False,
    remove_interference: bool = False,
) -> PowerMap:
    """Return only the power of `range_doppler`; the spectra are never stored."""
    options = range_window, doppler_window, remove_static, remove_interference
    return _transform(cube, *options, keep=False)[1]


def _transform(cube, range_window, doppler_window, static, crossing, *, keep) -> Any:
    """Spectra, or None unless they are kept, and power, antenna by antenna."""
    cube = as_samples(cube)
    if crossing:
        cube, _ = excise_interference(cube)
    *batch, tx, rx, chirps, samples = cube.shape
    weight = np.outer(window(doppler_window, chirps), window(range_window, samples))
    if chirps % 2 == 0:
        weight *= (-1.0) ** np.arange(chirps)[:, None]
    weight = jnp.asarray(weight, cube.real.dtype)

    def add(power, antenna):
        if static:
            antenna = antenna - antenna.mean(-2, keepdims=True)
        if jnp.iscomplexobj(antenna):
            weighted = jax.lax.complex(antenna.real * weight, antenna.imag * weight)
            spectrum = jnp.fft.fft2(weighted)
        else:
            spectrum = jnp.fft.rfft2(antenna * weight)[..., : samples // 2]
        power += spectrum.real**2 + spectrum.imag**2
        return power, spectrum if keep else None

    antennas = jnp.moveaxis(cube.reshape(*batch, tx * rx, chirps, samples), -3, 0)
    bins = samples if jnp.iscomplexobj(cube) else samples // 2
    start = jnp.zeros((*batch, chirps, bins), cube.real.dtype)
    power, spectrum = jax.lax.scan(add, start, antennas)
    if spectrum is not None:
        spectrum = jnp.moveaxis(spectrum, 0, -3)
    if chirps % 2:
        shift = functools.partial(jnp.fft.fftshift, axes=-2)
        spectrum, power = jax.tree.map(shift, (spectrum, power))
    return spectrum, power
