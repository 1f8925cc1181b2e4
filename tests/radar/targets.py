"""One geometry, few options and a few targets, so that compiled programs are shared."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from jradar.radar import (
    PointSpec,
    Radar,
    RadarSpec,
    Scatterers,
    radar_points,
    simulate_cube,
)
from tests.directions import unit

SMALL = RadarSpec.awr1843(num_chirps=32, num_samples=64)  # two rows
FLAT = RadarSpec.awr1642(num_chirps=32, num_samples=64)  # one row
SINGLE = {"tx_positions": ((0, 0),), "rx_positions": ((0, 0),)}
ONE = dataclasses.replace(SMALL, **SINGLE, tx_firing_order=())
COLUMN = dataclasses.replace(ONE, rx_positions=((0, 0), (0, 1)))
CASCADE = RadarSpec.cascade(num_samples=64)  # four rows, another firing order
LIGHT = 299_792_458.0

CELLS = PointSpec(detector="ca", capacity=3000)  # more than SMALL has cells
STATIC = dataclasses.replace(CELLS, capacity=100, refine=False, remove_static=True)
WIDE = PointSpec(guard=(1, 2), train=(2, 4))  # fits the cascade's 16 chirps


def place(distance, azimuth_deg, elevation_deg):
    """Position in metres."""
    return distance * unit(*np.radians([azimuth_deg, elevation_deg]))


def target(distance, azimuth_deg, elevation_deg, velocity, amplitude=100.0):
    """One scatterer."""
    return Scatterers(
        xyz=jnp.asarray([place(distance, azimuth_deg, elevation_deg)], jnp.float32),
        velocity=jnp.array([velocity], jnp.float32),
        amplitude=jnp.array([amplitude], jnp.float32),
    )


def targets(*places, amplitude=100.0):
    """Several scatterers: distance, azimuth, elevation and velocity of each."""
    each = (target(*one, amplitude=amplitude)[:3] for one in places)
    return Scatterers(*map(jnp.concatenate, zip(*each, strict=True)))


def simulate(scatterers, radar=SMALL, seed=0, noise_power=1.0):
    """A cube with noise of power 1."""
    key = jax.random.key(seed)
    return simulate_cube(key, scatterers, radar, noise_power=noise_power)


def cloud_of(cube, radar=SMALL, points=CELLS):
    """The radar points of a cube, on the host."""
    unit = radar if isinstance(radar, Radar) else Radar(radar)
    return jax.tree.map(np.asarray, radar_points(cube, unit, points=points))


def spherical(xyz):
    """Distance, azimuth and elevation in float64."""
    x, y, z = np.asarray(xyz, np.float64).T
    distance = np.sqrt(x**2 + y**2 + z**2)
    return distance, np.arctan2(y, x), np.arcsin(z / distance)


def degrees(cloud, count=1):
    """Azimuth and elevation of the first points, `[point, 2]`."""
    return np.degrees(spherical(cloud.xyz[:count])[1:]).T


def exact_chirp(radar, xyz):
    """Samples [tx, rx, sample] of a target at rest, from its distances to antennas."""
    spacings = [radar.spacing_wavelengths, radar.row_spacing_wavelengths]
    metres = radar.wavelength_m * np.array(spacings)
    tx, rx = (-np.array(p) * metres for p in (radar.tx_positions, radar.rx_positions))
    middle = (tx.mean(0) + rx.mean(0)) / 2
    legs = [
        np.hypot(xyz[0], np.linalg.norm(xyz[1:] - antennas + middle, axis=1))
        for antennas in (tx, rx)
    ]
    delay = (legs[0][:, None] + legs[1]) / LIGHT
    return np.exp(2j * np.pi * delay[..., None] * sweep(radar))


def sweep(radar):
    """Frequency at each sample."""
    sample_s = np.arange(radar.num_samples) / radar.sample_rate_hz
    at_s = radar.adc_start_time_s + sample_s
    return radar.start_frequency_hz + radar.slope_hz_per_s * at_s


def sines(azimuth, elevation):
    """Direction sines u and w."""
    return np.sin(azimuth) * np.cos(elevation), np.sin(elevation)


def waves_towards(radar, u, w, phase=0.0):
    """Snapshots of far targets at these direction sines, `[..., virtual]`."""
    columns, rows = radar.virtual_positions.T
    turns = np.multiply.outer(u, columns * radar.spacing_wavelengths)
    turns = turns + np.multiply.outer(w, rows * radar.row_spacing_wavelengths)
    return np.exp(1j * (2 * np.pi * turns + phase))


def plane_wave(radar, azimuth, elevation):
    """The same at these angles in radians."""
    return waves_towards(radar, *sines(*np.float64([azimuth, elevation])))


def noise(*shape, seed=0):
    """Complex noise of power 2."""
    return np.random.default_rng(seed).normal(size=(*shape, 2)) @ [1, 1j]


def single(values):
    """The numbers as complex64."""
    return jnp.asarray(values, jnp.complex64)


def close(actual, expected, tolerance=1e-4):
    """Compare all leaves of two trees."""
    pairs = zip(jax.tree.leaves(actual), jax.tree.leaves(expected), strict=True)
    for one, other in pairs:
        np.testing.assert_allclose(one, other, rtol=tolerance, atol=tolerance)
