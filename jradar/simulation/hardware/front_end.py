"""What a receiver adds to the signal between antenna and ADC, beyond noise.

    phase drift      the transmitted phase wanders within a frame, for all channels
    edge             the filter before the ADC loses power at the largest ranges
    image            gain and phase of I and Q differ: a mirror image in range
    offset           a constant voltage on I and on Q

`distort` applies them in the order in which they arise. The levels belong to a unit
(see `units`).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Key

from jradar.radar import RadarSpec
from jradar.simulation.units import UnitSpec

EDGE_STARTS = 0.75  # share of the range axis at which the filter begins to fall


class FrontEnd(NamedTuple):
    """Distortions of one unit's receivers, the same in every frame."""

    drift_rad: Float[np.ndarray, ""]  # rms within a frame
    response: Float[np.ndarray, " sample"]  # amplitude of each range bin
    image: Complex[np.ndarray, " rx"]  # factor of the conjugated signal
    offset: Complex[np.ndarray, " rx"]  # ADC counts


def make_front_end(
    random: np.random.Generator, unit: UnitSpec, radar: RadarSpec
) -> FrontEnd:
    """Return the distortions of a unit, with the phases of its receivers."""
    share = np.arange(radar.num_samples) / radar.num_samples
    fall = np.clip((share - EDGE_STARTS) / (1 - EDGE_STARTS), 0, 1) ** 2
    turn, angle = np.exp(2j * np.pi * random.random((2, radar.num_rx)))
    image = 0.0 if unit.image_db is None else 10 ** (unit.image_db / 20)
    return FrontEnd(
        np.array(1e-3 * unit.drift_mrad, np.float32),
        (10 ** (-unit.edge_db * fall / 20)).astype(np.float32),
        (image * turn).astype(np.complex64),
        (unit.offset_counts * angle).astype(np.complex64),
    )


def distort(
    key: Key[Array, ""],
    cube: Complex[Array, "tx rx chirp sample"],
    front_end: FrontEnd,
    radar: RadarSpec,
) -> Complex[Array, "tx rx chirp sample"]:
    """Return the samples as the ADC of a unit sees them."""
    turn = jnp.exp(1j * phase_drift(key, front_end.drift_rad, radar))
    spectrum = jnp.fft.fft(cube * turn[:, None, :, None]) * front_end.response
    filtered = jnp.fft.ifft(spectrum)
    image, offset = (
        column[:, None, None] for column in (front_end.image, front_end.offset)
    )
    return filtered + image * jnp.conj(filtered) + offset


def phase_drift(
    key: Key[Array, ""], rms: Float[Array | np.ndarray, ""], radar: RadarSpec
) -> Float[Array, "tx chirp"]:
    """Return a random walk of the phase over the chirps of a frame, in radians.

    Its mean over the frame is 0. `rms` is the root mean square over frames and chirps:
    a walk of n steps of variance s^2 about its mean has (n^2 - 1) / 6 n times s^2.
    """
    count = radar.num_tx * radar.num_chirps
    step = rms * (6 * count / (count**2 - 1)) ** 0.5
    walk = jnp.cumsum(step * jax.random.normal(key, (count,)))
    fired = (walk - walk.mean()).reshape(radar.num_chirps, radar.num_tx)
    return fired[:, radar.firing_position].T
