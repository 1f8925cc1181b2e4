"""Corrections of the virtual array's phases before the angles are estimated."""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Int

from jradar.radar.sensor import RadarSpec


@functools.partial(jax.jit, static_argnames="radar")
def compensate_tdm(
    snapshot: Complex[Array, "*batch virtual"],
    doppler_bin: Int[Array, "*batch"],
    radar: RadarSpec,
) -> Complex[Array, "*batch virtual"]:
    """Undo the phase that a moving target gains between the transmitters' chirps.

    In signed Doppler bin k, transmitter t leads by 2 pi k f_t / (num_tx num_chirps),
    with f_t its place in the firing order.
    """
    lead = radar.firing_position.repeat(radar.num_rx) / radar.num_tx / radar.num_chirps
    cycles = doppler_bin[..., None] * jnp.asarray(lead, jnp.float32)
    return snapshot * jnp.exp(-2j * jnp.pi * cycles)
