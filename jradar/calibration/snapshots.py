"""The strong echoes of a frame as snapshots: one complex value per virtual antenna."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from jradar.compiled import jit
from jradar.options.points import PointSpec
from jradar.radar.channels import compensate_tdm
from jradar.radar.points import WRAPPED, cell_bins, frame_spectra
from jradar.radar.radar import Radar
from jradar.radar.samples import Cube

MIN_RANGE_M = 0.5  # nearer, the leakage of the antennas is not a plane wave
MIN_SNR = 100.0  # of an echo over the median cell


class Snapshots(NamedTuple):
    """Strong echoes of a frame, strongest first; those with power 0 are padding."""

    snapshot: Complex[Array, "*batch echo virtual"]  # of the strongest cell, TDM undone
    range_m: Float[Array, "*batch echo"]
    velocity_mps: Float[Array, "*batch echo"]
    power: Float[Array, "*batch echo"]  # ADC counts squared, summed over antennas


@jit(static_argnames="count")
def strong_snapshots(cube: Cube, radar: Radar, *, count: int = 64) -> Snapshots:
    """Return the `count` strongest echoes of one frame, beyond 0.5 m; `vmap` it.

    An echo is a maximum of the range-Doppler map, 20 dB over the median cell. The
    radar's calibration is applied first.
    """
    spec, points = radar.spec, PointSpec().subtracting(radar.leakage)
    spectrum, power = frame_spectra(cube, radar, points)
    num_doppler, num_range = power.shape
    left, right = (jnp.roll(power, shift, -1) for shift in (1, -1))
    highest = (power > left) & (power >= right) & (power > MIN_SNR * jnp.median(power))
    if num_doppler > 1:
        below, above = (jnp.roll(power, shift, -2) for shift in (1, -1))
        highest &= (power > below) & (power >= above)
    number = np.arange(num_range)
    usable = (number * spec.range_resolution_m > MIN_RANGE_M) & (
        number < num_range - WRAPPED
    )
    found, cell = jax.lax.top_k(
        jnp.where(highest & usable[None], power, 0.0).ravel(), min(count, power.size)
    )
    range_bin, doppler_bin = cell_bins(power, cell, points)
    snapshot = spectrum.reshape(spec.num_virtual, -1)[:, cell].T
    snapshot = compensate_tdm(snapshot, doppler_bin, spec)
    return Snapshots(
        snapshot=jnp.where(found[:, None] > 0, snapshot, 0.0),
        range_m=range_bin * spec.range_resolution_m,
        velocity_mps=doppler_bin * spec.velocity_resolution_mps,
        power=found,
    )
