"""The tilt of an array from its motion: exact on a still world, refused without one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.calibration import level_tilt
from jradar.calibration.level import untilted
from jradar.radar import RadarSpec
from jradar.types import PointCloud

CHIP = RadarSpec.awr1843()
FRAMES, POINTS = 8, 60


def seen(velocity, tilt_deg, *, noise_mps=0.0, seed=0):
    """Clouds [frame, point] of a still world by a tilted array moving at `velocity`."""
    random = np.random.default_rng(seed)
    azimuth = random.uniform(-1.0, 1.0, (FRAMES, POINTS))
    elevation = random.uniform(-0.3, 0.3, (FRAMES, POINTS))
    u, w = np.sin(azimuth) * np.cos(elevation), np.sin(elevation)
    direction = np.stack([np.sqrt(1 - u**2 - w**2), u, w], -1)
    motion = np.broadcast_to(velocity, (FRAMES, 3))
    doppler = -np.einsum("fpi,fi->fp", direction, motion)
    doppler += noise_mps * random.standard_normal(doppler.shape)
    shifted = w + np.sin(np.radians(tilt_deg))
    measured = np.stack([np.sqrt(1 - u**2 - shifted**2), u, shifted], -1)
    distance = random.uniform(1, 10, (FRAMES, POINTS, 1))
    return PointCloud(
        xyz=jnp.asarray(distance * measured, jnp.float32),
        valid=jnp.ones((FRAMES, POINTS), bool),
        power=jnp.ones((FRAMES, POINTS)),
        velocity=jnp.asarray(doppler, jnp.float32),
    )


def degrees(sine):
    return np.degrees(np.arcsin(sine))


@pytest.mark.parametrize("tilt_deg", [-12.0, 0.0, 9.3])
@pytest.mark.parametrize("velocity", [(1.2, 0.3, 0.0), (-0.8, 0.0, 0.0)])
def test_the_tilt_is_found_ahead_and_back(tilt_deg, velocity):
    found = level_tilt(seen(velocity, tilt_deg), CHIP)
    assert degrees(found.sine) == pytest.approx(tilt_deg, abs=0.2)
    assert found.frames == FRAMES and degrees(found.deviation) < 0.2


def test_steps_up_and_down_average_out_and_show_in_the_deviation():
    bob = 0.1 * np.sin(2 * np.pi * np.arange(FRAMES) / 4)
    motion = np.stack([np.ones(FRAMES), np.zeros(FRAMES), bob], -1)
    found = level_tilt(seen(motion, 6.0, noise_mps=0.02), CHIP)
    assert degrees(found.sine) == pytest.approx(6.0, abs=3 * degrees(found.deviation))
    assert 0.5 < degrees(found.deviation) < 4


def test_a_mount_that_looks_down_is_no_tilt_of_the_array():
    down = np.radians(10.0)
    velocity = (np.cos(down), 0.0, np.sin(down))  # level, along the radar's axes
    up = (-np.sin(down), 0.0, np.cos(down))
    found = level_tilt(seen(velocity, 4.0), CHIP, up=up)
    assert degrees(found.sine) == pytest.approx(4.0, abs=0.2)


def test_factors_undo_the_phases_of_a_tilt():
    rows = CHIP.virtual_positions[:, 1]
    channels = np.exp(2j * np.pi * CHIP.row_spacing_wavelengths * 0.2 * rows)
    np.testing.assert_allclose(untilted(0.2, CHIP) * channels, 1, atol=1e-12)


@pytest.mark.parametrize(
    "velocity", [(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.2, 1.0, 0.0)]
)
def test_without_motion_ahead_nothing_is_said(velocity):
    with pytest.raises(ValueError, match="0 of 8 frames tell the tilt, expected 5"):
        level_tilt(seen(velocity, 5.0), CHIP)


def test_one_row_has_no_tilt():
    with pytest.raises(ValueError, match="one row of antennas"):
        level_tilt(seen((1.0, 0.0, 0.0), 0.0), RadarSpec.awr1642())


def test_invalid_points_do_not_count():
    cloud = seen((1.0, 0.0, 0.0), 5.0)
    false = jax.tree.map(lambda x: x, cloud)._replace(
        xyz=jnp.concatenate([cloud.xyz, -cloud.xyz], 1),
        valid=jnp.concatenate([cloud.valid, ~cloud.valid], 1),
        power=jnp.concatenate([cloud.power, cloud.power], 1),
        velocity=jnp.concatenate([cloud.velocity, 9 * cloud.velocity], 1),
    )
    assert degrees(level_tilt(false, CHIP).sine) == pytest.approx(5.0, abs=0.3)
