"""Corrections of antennas, on the cube, the spectra or the snapshots.

calibrate_channels          cube        factor of each virtual antenna, from a .cfg
calibrate_frequency_phase   cube        beat frequency and phase, from ColoRadar
subtract_coupling           spectrum    leakage from transmitters to receivers
compensate_tdm              snapshot    phase of moving targets from chirp to chirp

The axes tx and rx, or virtual, are in the order of the radar's array.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Inexact, Int

from jradar.radar.ranks import to_rank
from jradar.radar.samples import Cube, as_samples
from jradar.radar.sensor import RadarSpec
from jradar.radar.spectrum import WINDOWS, window


@jax.jit
def calibrate_channels(
    cube: Cube,
    factors: Complex[Array, "virtual"],
) -> Inexact[Array, "*batch tx rx chirp sample"]:
    """Multiply the samples of each virtual antenna by its factor.

    Real samples stay real: the positive half of their spectrum is multiplied. Raises
    ValueError unless there is one factor for each pair of tx and rx.
    """
    cube = as_samples(cube)
    tx, rx = cube.shape[-4:-2]
    if factors.size != tx * rx:
        raise ValueError(
            f"{factors.size} factors, expected {tx * rx}: one for each of {tx} tx x "
            f"{rx} rx"
        )
    factors = to_rank(factors.reshape(tx, rx, 1, 1), cube)
    if jnp.iscomplexobj(cube):
        return cube * factors
    return jnp.fft.irfft(jnp.fft.rfft(cube) * factors, cube.shape[-1])


@functools.partial(
    jax.jit,
    static_argnames=("radar", "calibration_slope_hz_per_s", "calibration_rate_hz"),
)
def calibrate_frequency_phase(
    cube: Cube,
    frequency: Float[Array, "tx rx"],
    phase: Complex[Array, "tx rx"],
    radar: RadarSpec,
    *,
    calibration_slope_hz_per_s: float,
    calibration_rate_hz: float,
) -> Complex[Array, "*batch tx rx chirp sample"]:
    """Equalise the antenna pairs: each then sees a far target as the first one does.

    `frequency` (range bins) and `phase` are the responses of the pairs to one target,
    measured with the calibration's slope and sampling rate. Raises ValueError where
    these differ from the radar's by a factor of 1000 or more.
    """
    slope = radar.slope_hz_per_s / calibration_slope_hz_per_s
    rate = calibration_rate_hz / radar.sample_rate_hz
    for ratio, what in ((slope, "slopes in Hz/s"), (rate, "sampling rates in Hz")):
        if not 1e-3 < ratio < 1e3:
            raise ValueError(
                f"radar's and calibration's {what} differ by a factor of {ratio:.3g}, "
                "expected 0.001 to 1000: another unit?"
            )
    cube = as_samples(cube)
    bins = (frequency - frequency[0, 0]) * (slope * rate)
    time = jnp.arange(cube.shape[-1]) / cube.shape[-1]
    turns = jnp.exp(-2j * jnp.pi * bins[..., None, None] * time[None, None, None])
    turns *= (phase[0, 0] / phase)[..., None, None]
    return cube * to_rank(turns, cube)


@functools.partial(jax.jit, static_argnames="doppler_window")
def subtract_coupling(
    range_doppler: Complex[Array, "*batch virtual doppler range"],
    coupling: Complex[Array, "tx rx half_range"],
    *,
    doppler_window: str = "hann",
) -> Complex[Array, "*batch virtual doppler range"]:
    """Subtract the leakage in ColoRadar's `coupling_calib.txt`, in ADC counts.

    `range_doppler` must come from `range_doppler(cube, range_window="blackman")` with
    the same `doppler_window`. The file contains range bins 1 .. N/2 of the plain FFT
    after a Blackman window; without the other bins it cannot be converted to another
    window. The leakage is steady, so it lies around Doppler bin 0, spread by the
    Doppler window. Raises ValueError for another array or another number of bins.
    """
    virtual, chirps, samples = range_doppler.shape[-3:]
    tx, rx, half = coupling.shape
    if (tx * rx, 2 * half) != (virtual, samples):
        raise ValueError(
            f"coupling of {tx} tx x {rx} rx x {half} range bins, expected {virtual} "
            f"virtual antennas and {samples // 2} bins, half of the spectrum's"
        )
    steady = np.fft.fftshift(np.fft.fft(window(doppler_window, chirps)).real)
    total = samples * WINDOWS["blackman"][0]  # sum of the window
    spread = jnp.asarray(steady / total, jnp.float32)
    leakage = coupling.reshape(virtual, 1, half) * spread[None, :, None]
    return range_doppler.at[..., 1 : half + 1].add(-to_rank(leakage, range_doppler))


@functools.partial(jax.jit, static_argnames="radar")
def compensate_tdm(
    snapshot: Complex[Array, "*batch virtual"],
    doppler_bin: Float[Array, "*batch"] | Int[Array, "*batch"],
    radar: RadarSpec,
) -> Complex[Array, "*batch virtual"]:
    """Undo the phase that a moving target gains between the chirps of transmitters.

    In signed Doppler bin k, transmitter t leads by 2 pi k f_t / (num_tx num_chirps),
    where f_t is its place in the firing order. `doppler_bin` may lie between bins.
    """
    if snapshot.shape[-1] != radar.num_virtual:
        raise ValueError(
            f"{snapshot.shape[-1]} values per snapshot, {radar.name} has "
            f"{radar.num_tx} tx x {radar.num_rx} rx = {radar.num_virtual}"
        )
    lead = radar.firing_position / radar.num_tx / radar.num_chirps
    doppler_bin = doppler_bin[..., None]
    cycles = doppler_bin * to_rank(np.float32(lead), doppler_bin)
    turn = jnp.exp(-2j * jnp.pi * cycles)
    return snapshot * jnp.repeat(turn, radar.num_rx, -1)
