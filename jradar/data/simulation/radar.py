"""A radar in a scene: the frame's paths, the ADC's samples of them, as int16."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int, Key

from jradar.data.simulation.echoes import Paths, radar_paths
from jradar.data.simulation.link import FULL_SCALE, LinkSpec
from jradar.data.simulation.reflectors import Reflectors
from jradar.data.simulation.rig import viewpoint
from jradar.data.simulation.scene import Scene, placements
from jradar.radar import RadarSpec, Scatterers, simulate_cube

CAPACITY = 1024  # paths of a frame
LEAKS = 3  # echoes of the leakage, in the first range bins
LINK = LinkSpec()


class Hardware(NamedTuple):
    """What makes a radar's channels imperfect: the same in every frame."""

    leakage: Complex[np.ndarray, "tx rx sample"]  # ADC counts, behind calibration
    frequency: Float[np.ndarray, "tx rx"]  # range bins by which a channel is late
    phase: Complex[np.ndarray, "tx rx"]  # factor of a channel


def make_hardware(sensor: str, radar: RadarSpec) -> Hardware:
    """The rig's radar `sensor`: leakage over the board, a few centimetres long.

    The cascade's channels differ in phase and delay, as its calibration file says;
    ColoRadar has no such file for the single chip, and its channels are alike here.
    """
    random = np.random.default_rng([*sensor.encode()])
    channels = (radar.num_tx, radar.num_rx)
    shape = (LEAKS, *channels, 1)
    each = np.array([1.0, 2.0, 4.0]).reshape(-1, 1, 1, 1)
    metres = random.uniform(0.02, 0.05, shape) * each
    amplitude = LINK.leakage_counts / each * random.uniform(0.5, 1.2, shape)
    bins = metres / radar.range_resolution_m / radar.num_samples
    turns = bins * np.arange(radar.num_samples) + random.random(shape)
    leakage = (amplitude * np.exp(2j * np.pi * turns)).sum(0)
    if sensor != "cascade":
        return Hardware(leakage, np.zeros(channels), np.ones(channels, complex))
    frequency = 0.05 * random.standard_normal(channels)
    gain = 1 + 0.05 * random.standard_normal(channels)
    phase = gain * np.exp(2j * np.pi * random.random(channels))
    return Hardware(leakage, frequency - frequency[0, 0], phase / phase[0, 0])


def frame_paths(
    scene: Scene, reflectors: Reflectors, sensor: str, time_s: float, radar: RadarSpec
) -> Paths:
    """All that the radar `sensor` of the rig receives at a time."""
    return radar_paths(
        scene,
        reflectors,
        placements(scene, time_s),
        viewpoint(scene.platform, sensor, time_s),
        radar,
        LINK,
        capacity=CAPACITY,
    )


def sample_frame(
    key: Key[Array, ""], paths: Paths, hardware: Hardware, radar: RadarSpec
) -> Int[Array, "tx rx chirp sample 2"]:
    """The frame as the ADC gives it: I and Q in int16, clipped at full scale.

    Returns at once: JAX works on while the caller prepares the next.
    """
    used = len(paths.power)

    def padded(column):
        column = np.asarray(column, np.float32)
        empty = np.zeros((CAPACITY - used, *column.shape[1:]), np.float32)
        return jnp.asarray(np.concatenate([column, empty]))

    scatterers = Scatterers(
        xyz=padded(paths.xyz),
        velocity=padded(paths.velocity),
        amplitude=padded(LINK.counts(paths.power)),
        departure=padded(paths.departure),
    )
    time = np.arange(radar.num_samples) / radar.num_samples
    turns = np.exp(2j * np.pi * hardware.frequency[..., None] * time)
    channels = turns * hardware.phase[..., None]
    return _sampled(
        key,
        scatterers,
        jnp.asarray(hardware.leakage, jnp.complex64),
        jnp.asarray(channels, jnp.complex64),
        radar,
        LINK.noise_power(radar),
    )


@functools.partial(jax.jit, static_argnames=("radar", "noise_power"))
def _sampled(key, scatterers, leakage, channels, radar, noise_power):
    """Samples as int16 pairs: the noise is the receivers' own, behind the channels."""
    quiet = simulate_cube(key, scatterers, radar)
    cube = (quiet + leakage[:, :, None]) * channels[:, :, None]
    noise = jax.random.normal(key, (*radar.cube_shape, 2)) * (noise_power / 2) ** 0.5
    counts = jnp.rint(jnp.stack([cube.real, cube.imag], -1) + noise)
    return jnp.clip(counts, -FULL_SCALE, FULL_SCALE - 1).astype(jnp.int16)
