"""Crossing chirps of other radars: their samples, and how these are excised.

A chirp of slope S' that crosses the radar's own of slope S beats against it. The beat
sweeps through the receiver's band in f_s / |S' - S| seconds, so a few samples of some
chirps are disturbed, in all receivers at once:

    sample  -->
    chirp  ........................      . echoes and noise
      |    .....######.............      # crossing chirp
      v    ........................
           ..............######....

In the spectrum, such a burst lies over all ranges and velocities, as noise does. Echoes
fill all samples and few cells. `excise_interference` takes the cells far over the floor
as the echoes, compares the rest of each sample with its usual power, and replaces the
samples that stand out by the echoes. It repeats this with lower thresholds, because the
floor falls with each pass (Bechter et al. 2017). The usual power is the larger of two
medians: over chirps (Wagner et al. 2018), and over the samples of the chirp. The second
is needed at the edges of the frame, where the windows are low and strong echoes are not
known well.

A radar whose chirps keep in step with the radar's own, so that a burst lies in the same
sample of most chirps, is not found.
"""

import functools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy  # loads `special` when it is first used
from jaxtyping import Array, Bool, Float, Inexact, Key

from jradar.compiled import jit
from jradar.options.sensor import RadarSpec
from jradar.radar.ranks import to_rank
from jradar.radar.samples import Cube, as_samples

PASSES = (8.0, 2.0, 1.0, 1.0)  # factors on the threshold: strong bursts come first
ECHO = 6.0  # power over the median cell from which a cell counts as an echo
SURE = 0.2  # window's weight below which the echoes are not known well
TINY = 1e-30  # in place of a rest of 0, in frames of zeros
EDGE = 0.1  # of the band, over which the receiver's filter falls to 0
BANDWIDTH_HZ = (0.5e9, 4e9)  # of another radar's sweep
SWEEP_S = (20e-6, 80e-6)  # its duration
IDLE = (1.1, 1.6)  # from sweep to sweep, in durations of one


class Interferers(NamedTuple):
    """Other radars: one sweep after another throughout the frame.

    Times count from the first chirp's ramp. Those with amplitude 0 are padding.
    """

    start_s: Float[Array, " interferer"]  # of one of the sweeps
    period_s: Float[Array, " interferer"]  # from sweep to sweep
    sweep_s: Float[Array, " interferer"]  # duration
    start_hz: Float[Array, " interferer"]  # relative to the start of the radar's chirp
    slope_hz_per_s: Float[Array, " interferer"]
    azimuth: Float[Array, " interferer"]  # radians, as seen by the receivers
    elevation: Float[Array, " interferer"]
    amplitude: Float[Array, " interferer"]  # ADC counts, inside the band


@jit(static_argnames=("radar", "count"))
def draw_interferers(
    key: Key[Array, ""],
    radar: RadarSpec,
    *,
    count: int,
    amplitude: float | Float[Array, "*interferer"],
) -> Interferers:
    """Return radars of random waveforms, times and directions in front of the radar.

    Each sweeps 0.5 to 4 GHz up or down, over the middle of the radar's samples, in 20
    to 80 us. Sweeps follow one another with pauses of 10 to 60 %.
    """
    part = jax.random.uniform(key, (8, count))

    def between(place, low, high):
        return low + (high - low) * part[place]

    sweep = between(0, *SWEEP_S)
    period = sweep * between(1, *IDLE)
    band = between(2, *BANDWIDTH_HZ) * jnp.where(part[3] < 0.5, -1, 1)
    middle = radar.center_frequency_hz - radar.start_frequency_hz
    return Interferers(
        start_s=part[4] * period,
        period_s=period,
        sweep_s=sweep,
        start_hz=middle - part[5] * band,
        slope_hz_per_s=band / sweep,
        azimuth=between(6, -jnp.pi / 3, jnp.pi / 3),
        elevation=between(7, -jnp.pi / 12, jnp.pi / 12),
        amplitude=jnp.broadcast_to(jnp.asarray(amplitude, jnp.float32), (count,)),
    )


@jit(static_argnames="radar")
def crossing_chirps(
    key: Key[Array, ""], interferers: Interferers, radar: RadarSpec
) -> Inexact[Array, "tx rx chirp sample"]:
    """Return the samples that other radars add to one frame, complex or real.

    The beat against the radar's chirp has the phase of a linear sweep, and a random one
    for each chirp (Kim, Mun & Lee 2018). It is heard where its frequency lies in the
    band: 0 to f_s of complex samples, -f_s / 2 to f_s / 2 of real ones. A beat that
    crosses the band in less than a sample rings for one sample with the same energy.
    """
    turn_s = radar.turn_period_s * np.arange(radar.num_chirps)
    first_s = radar.chirp_period_s * radar.firing_position[:, None] + turn_s
    sample_s = np.arange(radar.num_samples) / radar.sample_rate_hz
    first_s, sample_s = jnp.float32(first_s), jnp.float32(sample_s)
    phases = (len(interferers.amplitude), *first_s.shape)
    phase = jax.random.uniform(key, phases)[..., None]

    def add(total, each):
        it, cycles = each
        samples = _one(it, cycles, first_s, sample_s, radar)
        return total + samples.astype(total.dtype), None

    start = jnp.zeros(radar.cube_shape, jnp.complex64)
    samples, _ = jax.lax.scan(add, start, (interferers, phase))
    return samples.real if radar.real_samples else samples


def _one(it, cycles, first_s, sample_s, radar):
    """Samples of one interferer; `cycles` is the phase of its beat in each chirp."""
    own = radar.slope_hz_per_s
    # Reduced per chirp first: float32 resolves 1 ns of a frame, much less of a sweep.
    into = jnp.mod(first_s - it.start_s, it.period_s)[..., None]
    into = jnp.mod(into + radar.adc_start_time_s + sample_s[None, None], it.period_s)
    sample_s = sample_s[None, None]
    own_hz = own * (radar.adc_start_time_s + sample_s)
    beat_hz = own_hz - it.start_hz - it.slope_hz_per_s * into

    faster = own - it.slope_hz_per_s
    rate = radar.sample_rate_hz
    middle_hz = 0.0 if radar.real_samples else rate / 2
    length = rate**2 / jnp.maximum(jnp.abs(faster), 1.0)  # samples within the band
    width = rate / jnp.minimum(length, 1.0)
    edge = (2 * jnp.abs(beat_hz - middle_hz) / width - 1) / EDGE + 1
    heard = jnp.cos(jnp.pi / 2 * jnp.clip(edge, 0, 1))
    heard = jnp.where((edge < 1) & (into < it.sweep_s), heard, 0)
    heard *= it.amplitude * jnp.sqrt(jnp.minimum(length, 1.0))

    # The integral of the frequency from the first sample on.
    cycles += (beat_hz - faster * sample_s / 2) * sample_s
    chirps = heard * jnp.exp(2j * jnp.pi * jnp.mod(cycles, 1.0))
    sines = jnp.sin(it.azimuth) * jnp.cos(it.elevation), jnp.sin(it.elevation)
    columns, rows = jnp.float32(np.array(radar.rx_positions).T)
    turns = radar.spacing_wavelengths * columns * sines[0]
    turns += radar.row_spacing_wavelengths * rows * sines[1]
    return chirps[:, None] * jnp.exp(2j * jnp.pi * turns)[None, :, None, None]


@jit(static_argnames="false_alarm_rate")
def excise_interference(
    cube: Cube, *, false_alarm_rate: float = 1e-8
) -> tuple[
    Inexact[Array, "*batch tx rx chirp sample"], Bool[Array, "*batch tx chirp sample"]
]:
    """Replace samples that a crossing chirp disturbs; also return which they are.

    A sample is disturbed if its power without the echoes, summed over receivers,
    exceeds both the median over all chirps and that over its chirp's samples by a
    factor, which noise does at `false_alarm_rate`. Its two neighbours count as
    disturbed, too. All others are returned bit for bit. A frame of one chirp has no
    median over chirps, and is returned as it is.
    """
    cube = as_samples(cube)
    freedom = cube.shape[-3] * (1.0 if jnp.iscomplexobj(cube) else 0.5)
    factor = scipy.special.gammainccinv(
        freedom, false_alarm_rate
    ) / scipy.special.gammainccinv(freedom, 0.5)
    return _excised(cube, jnp.asarray(factor * np.array(PASSES), cube.real.dtype))


def _passes(cube, times, *, spare=True):
    """Excise frames by these thresholds; a pass that no frame needs is skipped."""
    weight = to_rank(np.asarray(taper(*cube.shape[-2:]), cube.real.dtype), cube)
    unsure = jnp.maximum(1, SURE / weight[..., 0, :, :]) ** 2

    def left_over(cleaned):
        """The echoes, and each sample's power without them over the usual power."""
        echoes = _echoes(cleaned * weight)
        left = cube * weight - echoes
        power = (left.real**2 + left.imag**2).sum(-3) / weight[..., 0, :, :] ** 2
        usual = jnp.maximum(positive_median(power, (-3, -2)), _at_edges(power))
        return echoes, power / jnp.maximum(usual * unsure, TINY)

    def one_pass(state, most):
        needed = state[2]

        def excise():
            echoes, ratio = left_over(state[0])
            found = _with_neighbours(ratio > most)
            echoes = echoes / jnp.maximum(weight, SURE / 10)
            replaced = jnp.where(found[..., None, :, :], echoes, cube)
            # If at first nothing exceeds the last threshold, the lowest, that is all.
            more = (ratio > times[-1]).any((-3, -2, -1)) | (most < times[0])
            return jax.tree.map(
                lambda new, old: jnp.where(_to_left(needed, new), new, old),
                (replaced, found, more),
                state,
            )

        if not spare:
            return excise(), None
        return jax.lax.cond(needed.any(), excise, lambda: state), None

    nowhere = jnp.zeros((*cube.shape[:-3], *cube.shape[-2:]), bool)
    start = cube, nowhere, jnp.ones(cube.shape[:-4], bool)
    (cleaned, disturbed, _), _ = jax.lax.scan(one_pass, start, times)
    return cleaned, disturbed


def _to_left(values, like):
    """Values of frames, with axes on the right up to the rank of others."""
    return values.reshape(*values.shape, *(like.ndim - values.ndim) * [1])


# `vmap` turns a condition into a selection, which computes all passes of all frames.
_batched = jax.custom_batching.custom_vmap(_passes)
_excised = jax.custom_jvp(_batched)


@_batched.def_vmap
def _together(_size, _batched_arguments, cube, times):  # of which the cube alone is
    return _batched(cube, times), (True, True)


@_excised.defjvp
def _jvp(primals, tangents):
    # JAX cannot transpose a condition that `vmap` has turned into a selection.
    every = functools.partial(_passes, spare=False)
    _, change = jax.jvp(every, primals, tangents)
    return _excised(*primals), change


def taper(chirps: int, samples: int) -> np.ndarray:
    """Return Hann windows of both axes, nowhere 0: they keep echoes in few cells."""
    return np.outer(np.hanning(chirps + 2)[1:-1], np.hanning(samples + 2)[1:-1])


def _echoes(cube):
    """The part of the samples in cells far over the floor, `ECHO` times the median."""
    is_complex, size = jnp.iscomplexobj(cube), cube.shape[-2:]
    spectrum = jnp.fft.fft2(cube) if is_complex else jnp.fft.rfft2(cube)
    power = (spectrum.real**2 + spectrum.imag**2).sum((-4, -3), keepdims=True)
    floor = positive_median(power, (-2, -1))
    spectrum = jnp.where(power > ECHO * floor, spectrum, 0)
    return jnp.fft.ifft2(spectrum) if is_complex else jnp.fft.irfft2(spectrum, s=size)


def _at_edges(power):
    """What strong echoes leave in each chirp, alike at both ends of the frame."""
    each = positive_median(power, (-3, -1))
    return jnp.minimum(each, each[..., ::-1, :])


def positive_median(power: jax.Array, axes: tuple[int, ...]) -> jax.Array:
    """Return `jnp.median` of values from 0 up, with the axes kept, without a sort."""
    # Such floats are in the order of their bits. From the highest on, a bit of the
    # middle value is 1 if, with it, no more values lie below than belong there.
    width = 8 * power.dtype.itemsize
    kind = jnp.dtype(f"int{width}")
    bits = jax.lax.bitcast_convert_type(power, kind)
    count = math.prod(power.shape[axis] for axis in axes)
    below = (count - 1) // 2

    def set_bit(place, found):
        tried = found | jnp.asarray(1, kind) << (width - 2 - place).astype(kind)
        fits = (bits < tried).sum(axes, keepdims=True) <= below
        return jnp.where(fits, tried, found)

    zeros = jnp.zeros_like(bits.max(axes, keepdims=True))
    lower = jax.lax.fori_loop(0, width - 1, set_bit, zeros)
    value = jax.lax.bitcast_convert_type(lower, power.dtype)
    if count % 2:
        return value
    more = jnp.where(bits > lower, power, jnp.inf).min(axes, keepdims=True)
    alone = (bits <= lower).sum(axes, keepdims=True) == below + 1
    return (value + jnp.where(alone, more, value)) / 2


def _with_neighbours(disturbed):
    later = disturbed.at[..., 1:].max(disturbed[..., :-1])
    return later.at[..., :-1].max(disturbed[..., 1:])
