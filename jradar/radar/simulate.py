"""Point scatterers to an ADC cube: the forward model that the processing inverts.

A scatterer at range R(t) = R + v t returns the beat signal

    a exp(2 pi j (2 R(t) / c * f(n) + d (a_az u + a_el w)))

in sample n of the chirp that starts at time t, 0 in the middle of the frame. The chirp
has the frequency f(n) there, d is the spacing of the antenna positions, and (u, w) =
(sin az cos el, sin el) is the direction. The range is constant within a chirp. After a
reflection the wave may return on another path: then R is the mean of both legs, and
transmitters and receivers see different directions. Waves are plane, antennas
isotropic, and the amplitudes include the whole radar equation.

The signal is a phasor per chirp times a phasor per sample, apart from one term: the
change of range times the sample's frequency. Over a block of a few chirps this term is
linearised about the middle of the block, which takes one matrix product. The error is
at most 0.6 % of the amplitude up to the radar's `max_velocity_mps`, and grows with the
square of the velocity.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Inexact, Key

from jradar.compiled import jit
from jradar.options.sensor import SPEED_OF_LIGHT, RadarSpec

TIMES = ("middle", "start")  # of a frame
MOST_DRIFT = 0.105  # radians in the linear term; the error is its square over 2


class Scatterers(NamedTuple):
    """Point scatterers; those with amplitude 0 are padding."""

    xyz: Float[Array, "point 3"]  # metres, in the middle of the frame
    velocity: Float[Array, " point"]  # m/s, radial, positive when receding
    amplitude: Float[Array, " point"]  # of each sample, in ADC counts
    departure: Float[Array, "point 3"] | None = None  # as seen by the transmitters


@jit(static_argnames=("radar", "noise_power", "at"))
def simulate_cube(
    key: Key[Array, ""],
    scatterers: Scatterers,
    radar: RadarSpec,
    *,
    noise_power: float = 0.0,
    at: str = "middle",
) -> Inexact[Array, "tx rx chirp sample"]:
    """Return the ADC samples of one frame, complex or real; `vmap` it.

    White noise of mean power `noise_power` (counts squared) is added. With
    `departure`, `xyz` is the position as seen by the receivers. Ranges are those in
    the middle of the frame, as `radar_points` measures them, or with `at="start"` those
    at its first chirp.
    """
    if at not in TIMES:
        raise ValueError(f"{at=}, expected one of {TIMES}")
    back, receive = _seen(scatterers.xyz, radar.rx_positions, radar)
    there = scatterers.departure
    there = scatterers.xyz if there is None else there
    away, transmit = _seen(there, radar.tx_positions, radar)
    distance = (away + back) / 2

    # Cycles that are constant within the frame, reduced mod 1 to keep small changes.
    middle = (radar.num_samples - 1) / 2
    middle_s = radar.adc_start_time_s + middle / radar.sample_rate_hz
    middle_hz = radar.start_frequency_hz + radar.slope_hz_per_s * middle_s
    cycles_per_m = 2 * middle_hz / SPEED_OF_LIGHT
    weight = scatterers.amplitude * _turn(jnp.mod(cycles_per_m * distance, 1.0))
    sample = jnp.arange(radar.num_samples) - middle
    cycles_per_m_sample = 2 * radar.slope_hz_per_s / SPEED_OF_LIGHT
    cycles_per_m_sample /= radar.sample_rate_hz

    block = _block(radar)
    firing_s = radar.chirp_period_s * jnp.array(radar.firing_position)
    within_s = radar.turn_period_s * jnp.arange(block)[:, None] + firing_s[None]
    within_s, first_s = within_s - within_s.mean(), within_s.mean()
    if at == "middle":
        first_s -= radar.frame_middle_s

    # The same in all blocks: phasors `[chirp tx rx point]`, and the drift about the
    # middle. The beats `[point sample]` change by a constant factor between blocks.
    velocity, within_s = scatterers.velocity[None, None], within_s[..., None]
    chirp = _turn(cycles_per_m * velocity * within_s)
    chirps = ((weight[None] * transmit)[None] * chirp)[:, :, None]
    chirps = chirps * receive[None, None]
    drift = 2j * jnp.pi * cycles_per_m_sample * velocity
    linear = chirps * (drift * within_s)[:, :, None]
    pairs = jnp.concatenate([chirps, linear], -1)  # [chirp tx rx (2 point)]
    both = pairs.reshape(-1, 2 * drift.size)
    # A real matrix, for real parts stacked on imaginary parts.
    both = jnp.block([[both.real, -both.imag], [both.imag, both.real]])

    def beat(metres, moved):
        """Phasors `[point sample]` of targets at `metres` after they `moved`."""
        cycles = jnp.mod(cycles_per_m * moved, 1.0)[:, None]
        return _turn(cycles + cycles_per_m_sample * metres[:, None] * sample[None])

    def samples_of(beats, _):
        """Beats of the next block, and samples `[chirp-tx-rx sample]` of this one."""
        columns = jnp.concatenate([beats, beats * sample[None]])
        product = both @ jnp.concatenate([columns.real, columns.imag])
        return beats * step, jax.lax.complex(*jnp.split(product, 2))

    moved = scatterers.velocity * radar.turn_period_s * block
    step = beat(moved, moved)
    moved = scatterers.velocity * first_s
    first, count = beat(distance + moved, moved), radar.num_chirps // block
    _, blocks = jax.lax.scan(samples_of, first, None, length=count)
    shape = (radar.num_chirps, radar.num_tx, radar.num_rx, radar.num_samples)
    cube = jnp.moveaxis(blocks.reshape(shape), 0, 2)
    if radar.real_samples:
        noise = jax.random.normal(key, radar.cube_shape)
        return cube.real + jnp.sqrt(noise_power) * noise
    if not noise_power:
        return cube
    real, imaginary = jnp.sqrt(noise_power / 2) * jax.random.normal(
        key, (2, *radar.cube_shape)
    )
    return cube + jax.lax.complex(real, imaginary)


def _block(radar):
    """Number of chirps in a block: drift stays small up to `max_velocity_mps`."""
    drift = math.pi * radar.max_velocity_mps * radar.turn_period_s / 2
    most = max(int(MOST_DRIFT * radar.range_resolution_m / drift), 1)
    return max(k for k in range(1, most + 1) if radar.num_chirps % k == 0)


def _seen(xyz, positions, radar):
    """Distances, and phasors `[antenna point]` of plane waves at the antennas."""
    distance = jnp.linalg.norm(xyz, axis=-1)
    direction = xyz[:, 1:] / jnp.maximum(distance, 1e-6)[:, None]
    columns = jnp.array(np.array(positions) * [1.0, radar.row_spacing])
    return distance, _turn(radar.spacing_wavelengths * columns @ direction.T)


def _turn(cycles):
    """Unit phasor of a phase in cycles."""
    return jnp.exp(2j * jnp.pi * cycles)
