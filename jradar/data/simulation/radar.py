"""A radar in a scene: the frame's paths, the ADC's samples of them, as int16."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Int, Key

from jradar.data.simulation.echoes import Paths, radar_paths
from jradar.data.simulation.link import FULL_SCALE, LinkSpec
from jradar.data.simulation.reflectors import Reflectors
from jradar.data.simulation.rig import viewpoint
from jradar.data.simulation.scene import Scene, placements
from jradar.radar import RadarSpec, Scatterers, simulate_cube

CAPACITY = 1024  # paths of a frame
LEAKS = 3  # echoes of the leakage, in the first range bins
LINK = LinkSpec()


class Leakage(NamedTuple):
    """What leaks from transmitters to receivers: the same in every chirp."""

    samples: Complex[np.ndarray, "tx rx sample"]  # ADC counts


def make_leakage(random: np.random.Generator, radar: RadarSpec, link: LinkSpec) -> Leakage:
    """A radar's own leakage over the board and its cover, a few centimetres long."""
    shape = (LEAKS, radar.num_tx, radar.num_rx, 1)
    metres = random.uniform(0.02, 0.05, shape) * np.array([1, 2, 4]).reshape(-1, 1, 1, 1)
    strength = np.array([1.0, 0.4, 0.1]).reshape(-1, 1, 1, 1)
    amplitude = link.leakage_counts * strength * random.uniform(0.5, 1.2, shape)
    bins = metres / radar.range_resolution_m
    turns = bins * np.arange(radar.num_samples) / radar.num_samples + random.random(shape)
    return Leakage((amplitude * np.exp(2j * np.pi * turns)).sum(0))


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
    key: Key[Array, ""], paths: Paths, leakage: Leakage, radar: RadarSpec
) -> Int[np.ndarray, "tx rx chirp sample 2"]:
    """The frame as the ADC gives it: I and Q, rounded, clipped at full scale."""
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
    return np.asarray(
        _sampled(key, scatterers, jnp.asarray(leakage.samples, jnp.complex64), radar)
    )


@functools.partial(jax.jit, static_argnames="radar")
def _sampled(key, scatterers, leakage, radar):
    """Samples as int16 pairs."""
    cube = simulate_cube(key, scatterers, radar, noise_power=LINK.noise_power(radar))
    cube = cube + leakage[:, :, None]
    counts = jnp.rint(jnp.stack([cube.real, cube.imag], -1))
    return jnp.clip(counts, -FULL_SCALE, FULL_SCALE - 1).astype(jnp.int16)
