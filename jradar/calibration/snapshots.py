"""The strong echoes of a frame as snapshots: one complex value per virtual antenna."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from jradar.radar.channels import calibrate, compensate_tdm, subtract_leakage
from jradar.radar.peaks import window_offset
from jradar.radar.radar import Radar
from jradar.radar.samples import Cube
from jradar.radar.spectrum import range_doppler

MIN_RANGE_M = 0.5  # nearer, the leakage of the antennas is no plane wave
MIN_SNR = 100.0  # of an echo over the median cell


class Snapshots(NamedTuple):
    """Strong echoes of a frame, strongest first; those with power 0 are padding."""

    snapshot: Complex[Array, "*batch echo virtual"]  # of the strongest cell, TDM undone
    range_m: Float[Array, "*batch echo"]
    velocity_mps: Float[Array, "*batch echo"]
    power: Float[Array, "*batch echo"]  # ADC counts squared, summed over antennas


@functools.partial(jax.jit, static_argnames="count")
def strong_snapshots(cube: Cube, radar: Radar, *, count: int = 64) -> Snapshots:
    """Return the `count` strongest echoes of one frame, beyond 0.5 m; `vmap` it.

    An echo is a maximum of the range-Doppler map, 20 dB over the median cell. The
    radar's calibration is applied first.
    """
    spec, cube = radar.spec, calibrate(cube, radar)
    range_window = "hann" if radar.leakage is None else "blackman"
    spectrum, power = range_doppler(cube, range_window=range_window)
    if radar.leakage is not None:
        spectrum = subtract_leakage(spectrum, radar.leakage)
        power = (spectrum.real**2 + spectrum.imag**2).sum(0)
    num_doppler, num_range = power.shape
    left, right = (jnp.roll(power, shift, -1) for shift in (1, -1))
    below, above = (jnp.roll(power, shift, -2) for shift in (1, -1))
    highest = (power > left) & (power >= right) & (power > MIN_SNR * jnp.median(power))
    if num_doppler > 1:
        highest &= (power > below) & (power >= above)
    range_bin = np.arange(num_range)
    usable = (range_bin * spec.range_resolution_m > MIN_RANGE_M) & (
        range_bin < num_range - 2  # into which the window spreads the leakage
    )
    found, cell = jax.lax.top_k(
        jnp.where(highest & usable[None], power, 0.0).ravel(), min(count, power.size)
    )
    row, column = jnp.divmod(cell, num_range)

    def between(before, after, kind, length):
        powers = (values.ravel()[cell] for values in (before, power, after))
        return window_offset(*powers, kind=kind, length=length)

    doppler_bin = row - num_doppler // 2 + 0.0
    if num_doppler > 2:
        doppler_bin += between(below, above, "hann", num_doppler)
    range_bin = column + between(left, right, range_window, num_range)
    snapshot = spectrum.reshape(spec.num_virtual, -1)[:, cell].T
    snapshot = compensate_tdm(snapshot, doppler_bin, spec)
    return Snapshots(
        snapshot=jnp.where(found[:, None] > 0, snapshot, 0.0),
        range_m=range_bin * spec.range_resolution_m,
        velocity_mps=doppler_bin * spec.velocity_resolution_mps,
        power=found,
    )
