"""Point scatterers to an ADC cube: the forward model that the processing inverts.

A scatterer at range R(t) = R + v t returns the beat signal

    a exp(2 pi j (2 R(t) / c * f(n) + d (a_az u + a_el w)))

in sample n of the chirp that starts at time t, where the chirp's frequency is f(n); d
is the spacing of the antenna positions, (u, w) = (sin az cos el, sin el) the direction.
Its range may change by whole bins within a frame; within a chirp it stands still.
Waves are plane, antennas isotropic, and the amplitudes hold all of the radar equation.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float, Key

from jradar.radar.sensor import SPEED_OF_LIGHT, RadarSpec


class Scatterers(NamedTuple):
    """Point scatterers; pad a set with amplitudes of zero."""

    xyz: Float[Array, "point 3"]  # metres, at the frame's first chirp
    velocity: Float[Array, " point"]  # m/s, radial, positive when receding
    amplitude: Float[Array, " point"]  # of each sample, in ADC counts


@partial(jax.jit, static_argnames=("radar", "noise_power"))
def simulate_cube(
    key: Key[Array, ""],
    scatterers: Scatterers,
    radar: RadarSpec,
    *,
    noise_power: float = 0.0,
) -> Complex[Array, "tx rx chirp sample"]:
    """ADC samples of one frame; `vmap` it over frames.

    Complex white noise of mean power `noise_power` (counts squared) is added.
    """
    distance = jnp.linalg.norm(scatterers.xyz, axis=-1)
    direction = scatterers.xyz[:, 1:] / jnp.maximum(distance, 1e-6)[:, None]

    # Cycles that do not change within the frame, reduced before they meet small ones.
    first_hz = radar.start_frequency_hz + radar.slope_hz_per_s * radar.adc_start_time_s
    cycles_per_m = 2 * first_hz / SPEED_OF_LIGHT  # at a chirp's first sample
    fixed = jnp.mod(cycles_per_m * distance, 1.0)
    amplitude = scatterers.amplitude * _turn(fixed)
    receive = _turn(
        radar.spacing_wavelengths * direction @ jnp.array(radar.rx_positions).T
    )
    transmit = _turn(
        radar.spacing_wavelengths * direction @ jnp.array(radar.tx_positions).T
    )

    turn_s = radar.turn_period_s * jnp.arange(radar.num_chirps)
    firing_s = radar.chirp_period_s * jnp.array(radar.firing_position)
    fast_time_s = jnp.arange(radar.num_samples) / radar.sample_rate_hz
    hz_per_m = 2 * radar.slope_hz_per_s / SPEED_OF_LIGHT

    def chirp(start_s, transmit):
        """Samples `[rx, sample]` of one chirp."""
        moved = scatterers.velocity * start_s
        weight = amplitude * transmit * _turn(cycles_per_m * moved)
        beat_hz = hz_per_m * (distance + moved)
        return (weight[:, None] * receive).T @ _turn(beat_hz[:, None] * fast_time_s)

    def turns_of(args):
        """Samples `[chirp, rx, sample]` of one transmitter."""
        firing_s, transmit = args
        return jax.lax.map(
            lambda t: chirp(t + firing_s, transmit), turn_s, batch_size=16
        )

    cube = jax.lax.map(turns_of, (firing_s, transmit.T)).swapaxes(1, 2)
    real, imaginary = jnp.sqrt(noise_power / 2) * jax.random.normal(
        key, (2, *radar.cube_shape)
    )
    return cube + jax.lax.complex(real, imaginary)


def _turn(cycles):
    """Unit phasor after so many cycles."""
    return jnp.exp(2j * jnp.pi * cycles)
