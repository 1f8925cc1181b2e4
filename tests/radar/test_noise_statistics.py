"""Noise of a range-Doppler map: the level that was simulated, echoes set aside."""

import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import RadarSpec, noise_statistics, power_map
from tests.radar.targets import noise

RADAR = RadarSpec.awr1642(num_chirps=64, num_samples=128)
NOISE = 7 / 2**0.5 * noise(*RADAR.cube_shape)  # 7 counts in each sample


def test_noise_has_the_level_and_spread_that_were_simulated():
    found = noise_statistics(power_map(jnp.asarray(NOISE)), RADAR)
    assert found.counts_per_sample == pytest.approx(7, rel=0.02)
    assert found.spread_db == pytest.approx(found.pure_noise_spread_db, rel=0.05)
    echo = 2000 * np.exp(0.4j * np.pi * np.arange(RADAR.num_samples))
    loud = noise_statistics(power_map(jnp.asarray(NOISE + echo)), RADAR)
    assert loud.floor_db == pytest.approx(found.floor_db, abs=0.3)


def test_a_frame_of_zeros_has_no_noise():
    found = noise_statistics(np.zeros((64, 128)), RADAR)
    assert np.isfinite(found).all() and found.counts_per_sample == 0
