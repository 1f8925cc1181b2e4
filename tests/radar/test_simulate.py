"""The forward model: the exact phase within its bound, superposition, noise power."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import RadarSpec, Scatterers, simulate_cube
from tests.radar.targets import LIGHT, SMALL, simulate, sweep, target

RADAR = RadarSpec.awr1843(num_chirps=8, num_samples=16, tx_firing_order=(0, 2, 1))
KEY = jax.random.key(0)


def scatterers(xyz, velocity, amplitude, departure=None):
    values = (xyz, velocity, amplitude, departure)
    return Scatterers(*(v if v is None else np.asarray(v, np.float32) for v in values))


def nth(scene, i):
    """One of the scatterers."""
    return jax.tree.map(lambda values: values[i : i + 1], scene)


def exact(xyz, departure, velocity, radar):
    """One scatterer of amplitude 2 by the definition, in float64, sample by sample."""
    there, left = (np.asarray(np.float32(p), float) for p in (xyz, departure))
    legs = np.linalg.norm([there, left], axis=1)
    tx, rx = np.array(radar.tx_positions), np.array(radar.rx_positions)
    antennas = (tx @ left[1:] / legs[1])[:, None] + rx @ there[1:] / legs[0]
    time_s = radar.turn_period_s * np.arange(radar.num_chirps)
    time_s = time_s + radar.chirp_period_s * radar.firing_position[:, None]
    time_s = time_s - radar.turn_period_s * radar.num_chirps / 2
    now = np.mean(legs) + np.float64(np.float32(velocity)) * time_s
    cycles = 2 * now[:, None, :, None] / LIGHT * sweep(radar)
    cycles = cycles + radar.spacing_wavelengths * antennas[:, :, None, None]
    return 2 * np.exp(2j * np.pi * cycles)


@pytest.mark.parametrize(
    "radar",
    [
        dataclasses.replace(SMALL, tx_firing_order=(0, 2, 1)),
        RadarSpec.cascade(num_chirps=8),
    ],
    ids=["chip", "cascade"],
)
def test_whole_cube_is_the_exact_one_within_the_stated_bound(radar):
    """Which holds because targets of `max_velocity_mps` drift little in a block."""
    xyz, departure = np.array([3.0, 1.5, -0.7]), np.array([2.0, -6.0, 0.4])
    speed = radar.max_velocity_mps
    moving = scatterers([xyz], [speed], [2.0], [departure])
    error = simulate_cube(KEY, moving, radar) - exact(xyz, departure, speed, radar)
    still = scatterers([xyz], [0.0], [2.0])
    rounding = simulate_cube(KEY, still, radar) - exact(xyz, xyz, 0.0, radar)
    rounding = np.abs(rounding).max() / 2
    assert rounding < 6e-3  # float32 phases of some 5,000 turns, no block at work
    assert np.abs(error).max() / 2 < 6e-3 + rounding


def test_scatterers_add_up_and_padding_is_silent():
    both = scatterers([[3, 0, 0], [2, 1, 0], [0, 0, 0]], [0, 1, 0], [1, 2, 0])
    alone = [simulate_cube(KEY, nth(both, i), RADAR) for i in range(2)]
    total = simulate_cube(KEY, both, RADAR)
    np.testing.assert_allclose(total, alone[0] + alone[1], atol=1e-4)


def test_places_may_be_those_at_the_first_chirp():
    velocity = np.array([0.5, -0.4])
    there = scatterers([[3, 1, 0.2], [2, -1, 0]], velocity, [1, 2])
    distance = np.linalg.norm(there.xyz, axis=-1, keepdims=True)
    moved = velocity[:, None] * RADAR.turn_period_s * RADAR.num_chirps / 2
    earlier = jnp.asarray(there.xyz * (1 - moved / distance), jnp.float32)
    middle = simulate_cube(KEY, there, RADAR)
    start = simulate_cube(KEY, there._replace(xyz=earlier), RADAR, at="start")
    np.testing.assert_allclose(start, middle, atol=0.02)
    assert np.abs(simulate_cube(KEY, there, RADAR, at="start") - middle).max() > 0.5
    with pytest.raises(ValueError, match="at='end', expected one of"):
        simulate_cube(KEY, there, RADAR, at="end")


def test_noise_has_the_power_asked_for():
    noise = simulate(target(1, 0, 0, 0, amplitude=0.0), noise_power=9.0)
    np.testing.assert_allclose((np.abs(noise) ** 2).mean(), 9.0, rtol=0.02)


def test_gradient_reaches_the_scatterers():
    scene = scatterers([[3, 1, 0.2]], [0.5], [1], [[3.5, 1.5, 0.7]])
    power = jax.grad(lambda s: jnp.abs(simulate_cube(KEY, s, RADAR).sum()) ** 2)
    for slope in power(scene):
        assert np.isfinite(slope).all() and np.abs(slope).max() > 0
