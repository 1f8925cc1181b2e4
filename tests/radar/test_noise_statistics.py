"""Noise of a range-Doppler map: the level that was simulated, echoes set aside."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import RadarSpec, noise_statistics, power_map

RADAR = RadarSpec.awr1642(num_chirps=64, num_samples=128)


def noise(radar, rms):
    parts = rms * jax.random.normal(jax.random.key(0), (2, *radar.cube_shape))
    return parts[0] / 2**0.5 + 1j * parts[1] / 2**0.5


def test_noise_has_the_level_and_spread_that_were_simulated():
    found = noise_statistics(power_map(noise(RADAR, 7.0)), RADAR)
    assert found.counts_per_sample == pytest.approx(7, rel=0.02)
    assert found.spread_db == pytest.approx(found.pure_noise_spread_db, rel=0.05)


def test_a_strong_echo_does_not_raise_the_floor():
    cube, sample = noise(RADAR, 7.0), np.arange(RADAR.num_samples)
    echo = 2000 * jnp.exp(2j * jnp.pi * 0.2 * sample)
    quiet, loud = (noise_statistics(power_map(c), RADAR) for c in (cube, cube + echo))
    assert loud.floor_db == pytest.approx(quiet.floor_db, abs=0.3)


def test_a_frame_of_zeros_has_no_noise():
    found = noise_statistics(jnp.zeros((64, 128)), RADAR)
    assert np.isfinite(found).all() and found.counts_per_sample == 0
