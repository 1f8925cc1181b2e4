"""Corrections of antennas, on the cube, the spectra or the snapshots.

calibrate         cube        factor and beat frequency of each pair of antennas
subtract_leakage  spectrum    leakage from transmitters to receivers
compensate_tdm    snapshot    phase of moving targets from chirp to chirp

The axes tx and rx, or virtual, are in the order of the radar's array.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Inexact, Int

from jradar.compiled import jit
from jradar.options.points import WINDOWS
from jradar.options.sensor import RadarSpec
from jradar.radar.radar import Radar
from jradar.radar.ranks import to_rank
from jradar.radar.samples import Cube, as_samples
from jradar.radar.spectrum import window


@jit
def calibrate(cube: Cube, radar: Radar) -> Inexact[Array, "*batch tx rx chirp sample"]:
    """Return the samples with the channels of the radar equalised; leakage stays.

    Each pair of tx and rx is multiplied by its factor, and its beat frequency lowered
    by its offset in bins, so that all pairs see a far target alike. Real
    samples stay real: the positive half of their spectrum is multiplied. Raises
    ValueError for beat frequencies of real samples.
    """
    cube = as_samples(cube)
    if radar.channels is not None:
        factors = to_rank(jnp.asarray(radar.channels)[..., None, None], cube)
        if jnp.iscomplexobj(cube):
            cube = cube * factors.astype(cube.dtype)
        else:
            cube = jnp.fft.irfft(jnp.fft.rfft(cube) * factors, cube.shape[-1])
    if radar.beat_bins is not None:
        if not jnp.iscomplexobj(cube):
            raise ValueError(
                f"{radar.spec.name} delivers real samples, expected complex ones: beat "
                "frequencies are those of a cascade"
            )
        time = jnp.arange(cube.shape[-1]) / cube.shape[-1]
        bins = jnp.asarray(radar.beat_bins)[..., None, None]
        turns = jnp.exp(-2j * jnp.pi * bins * to_rank(time, bins))
        cube = cube * to_rank(turns, cube).astype(cube.dtype)
    return cube


@jit(static_argnames="doppler_window")
def subtract_leakage(
    range_doppler: Complex[Array, "*batch virtual doppler range"],
    leakage: Complex[Array, "tx rx half_range"],
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
    tx, rx, half = leakage.shape
    if (tx * rx, 2 * half) != (virtual, samples):
        raise ValueError(
            f"leakage of {tx} tx x {rx} rx x {half} range bins, expected {virtual} "
            f"virtual antennas and {samples // 2} bins, half of the spectrum's"
        )
    shape = np.fft.fftshift(np.fft.fft(window(doppler_window, chirps)).real)
    total = samples * WINDOWS["blackman"][0]  # sum of the window
    spread = jnp.asarray(shape / total, jnp.float32)
    steady = leakage.reshape(virtual, 1, half) * spread[None, :, None]
    return range_doppler.at[..., 1 : half + 1].add(-to_rank(steady, range_doppler))


@jit(static_argnames="radar")
def compensate_tdm(
    snapshot: Complex[Array, "*batch virtual"],
    doppler_bin: Float[Array, "*batch"] | Int[Array, "*batch"],
    radar: RadarSpec,
) -> Complex[Array, "*batch virtual"]:
    """Undo the phase that a moving target gains between the chirps of transmitters.

    In signed Doppler bin k, transmitter t leads by 2 pi k f_t / (num_tx num_chirps),
    where f_t is its place in the firing order. `doppler_bin` may lie between bins.
    """
    check_antennas(snapshot.shape, radar)
    lead = radar.firing_position / radar.num_tx / radar.num_chirps
    doppler_bin = doppler_bin[..., None]
    cycles = doppler_bin * to_rank(np.float32(lead), doppler_bin)
    turn = jnp.exp(-2j * jnp.pi * cycles)
    return snapshot * jnp.repeat(turn, radar.num_rx, -1)


def check_antennas(shape: tuple[int, ...], radar: RadarSpec) -> None:
    """Raise ValueError unless snapshots have one value for each virtual antenna."""
    if shape[-1] != radar.num_virtual:
        raise ValueError(
            f"{shape[-1]} values per snapshot, {radar.name} has "
            f"{radar.num_tx} tx x {radar.num_rx} rx = {radar.num_virtual}"
        )
