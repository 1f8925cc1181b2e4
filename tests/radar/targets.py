"""Radars, point options and targets that several tests share, so they compile once."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from jradar.radar import PointSpec, RadarSpec, Scatterers, simulate_cube

CHIP = RadarSpec.awr1843()
SMALL = RadarSpec.awr1843(num_chirps=32, num_samples=64)
FLAT = RadarSpec.awr1642(num_chirps=32, num_samples=64)
ONE = RadarSpec.awr1843(
    num_chirps=32, num_samples=64, tx_positions=((0, 0),), rx_positions=((0, 0),)
)
COLUMN = dataclasses.replace(ONE, rx_positions=((0, 0), (0, 1)))
CASCADE = RadarSpec.cascade()

CELLS = PointSpec(detector="ca", capacity=3000)  # more than SMALL has cells
ALL = dataclasses.replace(CELLS, false_alarm_rate=1.0)
STATIC = dataclasses.replace(CELLS, capacity=100, refine=False, remove_static=True)
WIDE = PointSpec(guard=(1, 2), train=(2, 4), num_azimuth=128)  # fits the cascade


def target(distance, azimuth_deg, elevation_deg, velocity, amplitude=100.0):
    """One scatterer."""
    az, el = np.radians(azimuth_deg), np.radians(elevation_deg)
    direction = [np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)]
    return Scatterers(
        xyz=jnp.asarray(distance * np.array([direction]), jnp.float32),
        velocity=jnp.array([velocity], jnp.float32),
        amplitude=jnp.array([amplitude], jnp.float32),
    )


def simulate(scatterers, radar=SMALL, seed=0):
    """A cube with noise of power 1."""
    return simulate_cube(jax.random.key(seed), scatterers, radar, noise_power=1.0)


def spherical(xyz):
    """Distance, azimuth and elevation in float64."""
    x, y, z = np.asarray(xyz, np.float64).T
    distance = np.sqrt(x**2 + y**2 + z**2)
    return distance, np.arctan2(y, x), np.arcsin(z / distance)
