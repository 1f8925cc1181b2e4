"""A radar in a scene: the frame's paths, the ADC's samples of them, as int16.

ColoRadar calibrates the cascade's channels, and has no calibration of the single chip.
Its channels here are those of a real AWR1843, from the coefficients that TI's demo
measured on one (`compRangeBiasAndRxChanPhase` of radarize_ae's 1843_v1.cfg): a factor
per transmitter times one per receiver holds all twelve to 0.3 dB and 3 degrees. They
spread by 3.5 dB and 47 degrees, on an AWR6843AOP measured alike by 3.1 dB and 30
degrees. The third transmitter's phase tilts the elevation by some 9 degrees, the
others' squint by 1; how much of it is the board, and how much a reflector that stood
beside boresight, the coefficients cannot tell. The range is 6.6 cm too long.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int, Key

from jradar.radar import RadarSpec, Scatterers, simulate_cube
from jradar.radar.sensor import SPEED_OF_LIGHT
from jradar.simulation.echoes import Paths, radar_paths
from jradar.simulation.link import FULL_SCALE, LinkSpec
from jradar.simulation.reflectors import Reflectors
from jradar.simulation.rig import viewpoint
from jradar.simulation.scene import Scene, placements
from jradar.simulation.synthesiser import SynthesiserSpec, sampling_errors

CAPACITY = 1024  # paths of a frame
LEAKS = 3  # echoes of the leakage, in the first range bins
LINK = LinkSpec()
SYNTHESISER = SynthesiserSpec()
SKIRTED = 128  # paths that the synthesiser's errors are worked out for, the strongest
# Of the single chip's channels, relative to the first: dB and degrees.
TX_DB, TX_DEGREES = (0.0, -0.97, -1.91), (0.0, 11.4, 34.7)
RX_DB, RX_DEGREES = (0.0, -0.14, -0.27, -1.29), (0.0, 2.5, 5.6, 14.7)
RANGE_BIAS_M = 0.0659


class Hardware(NamedTuple):
    """What makes a radar's channels imperfect: the same in every frame."""

    leakage: Complex[np.ndarray, "tx rx sample"]  # ADC counts, before the channels
    frequency: Float[np.ndarray, "tx rx"]  # range bins by which a channel is late
    phase: Complex[np.ndarray, "tx rx"]  # factor of a channel


def make_hardware(sensor: str, radar: RadarSpec) -> Hardware:
    """The rig's radar `sensor`: leakage over the board, a few centimetres long.

    Channels differ in gain, phase and delay: the cascade's as its calibration file
    says, the single chip's as measured on another board of its kind.
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
        late = np.full(channels, RANGE_BIAS_M / radar.range_resolution_m)
        return Hardware(leakage, late, _uncalibrated(radar))
    frequency = 0.05 * random.standard_normal(channels)
    gain = 1 + 0.05 * random.standard_normal(channels)
    phase = gain * np.exp(2j * np.pi * random.random(channels))
    return Hardware(leakage, frequency - frequency[0, 0], phase / phase[0, 0])


def _uncalibrated(radar):
    """Factors `[tx, rx]` of an AWR1843's channels."""
    sides = ((TX_DB, TX_DEGREES), (RX_DB, RX_DEGREES))
    tx, rx = (
        10 ** (np.array(db) / 20) * np.exp(1j * np.radians(degrees))
        for db, degrees in sides
    )
    return tx[: radar.num_tx, None] * rx[: radar.num_rx]


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

    amplitude = LINK.counts(paths.power)
    cycles_per_s = 2 * radar.slope_hz_per_s / SPEED_OF_LIGHT
    legs = np.linalg.norm(paths.xyz, axis=-1) + np.linalg.norm(paths.departure, axis=-1)
    rate = 2 * np.pi * cycles_per_s * legs / 2 * amplitude
    loud = np.argsort(-rate, kind="stable")
    xyz, velocity, departure, amplitude, rate = (
        padded(column[loud])
        for column in (paths.xyz, paths.velocity, paths.departure, amplitude, rate)
    )
    return _sampled(
        key,
        Scatterers(xyz, velocity, amplitude, departure),
        rate[:SKIRTED],
        jnp.asarray(hardware.leakage, jnp.complex64),
        jnp.asarray(channel_factors(hardware, radar), jnp.complex64),
        radar,
        LINK.noise_power(radar),
    )


def channel_factors(
    hardware: Hardware, radar: RadarSpec
) -> Complex[np.ndarray, "tx rx sample"]:
    """What the channels make of a sample: gain and phase, and delay as a frequency."""
    time = np.arange(radar.num_samples) / radar.num_samples
    turns = np.exp(2j * np.pi * hardware.frequency[..., None] * time)
    return turns * hardware.phase[..., None]


@functools.partial(jax.jit, static_argnames=("radar", "noise_power"))
def _sampled(key, scatterers, rate, leakage, channels, radar, noise_power):
    """Samples as int16 pairs: the noise is the receivers' own, behind the channels.

    `rate` is the change of the first scatterers' beats per second, from which the
    synthesiser's errors follow.
    """
    echoes = simulate_cube(key, scatterers, radar)
    strong = Scatterers(*(column[: len(rate)] for column in scatterers))
    change = 1j * simulate_cube(key, strong._replace(amplitude=rate), radar)
    late_s = sampling_errors(jax.random.fold_in(key, 1), radar, SYNTHESISER)
    echoes += change * late_s[:, None]
    cube = (echoes + leakage[:, :, None]) * channels[:, :, None]
    noise = jax.random.normal(key, (*radar.cube_shape, 2)) * (noise_power / 2) ** 0.5
    counts = jnp.rint(jnp.stack([cube.real, cube.imag], -1) + noise)
    return jnp.clip(counts, -FULL_SCALE, FULL_SCALE - 1).astype(jnp.int16)
