"""The tilt of an array from its motion: exact on a still world, refused without one."""

import jax
import numpy as np
import pytest

from jradar.calibration import level_tilt
from jradar.calibration.level import Tilt, untilted
from jradar.calibration.recording import _check_tilt
from jradar.radar import RadarSpec
from jradar.types import PointCloud
from tests.directions import unit

CHIP = RadarSpec.awr1843()
FRAMES, POINTS = 8, 60


def seen(velocity, tilt_deg, *, noise_mps=0.0, seed=0):
    """Clouds [frame, point] of a still world by a tilted array moving at `velocity`."""
    random = np.random.default_rng(seed)
    azimuth = random.uniform(-1.0, 1.0, (FRAMES, POINTS))
    elevation = random.uniform(-0.3, 0.3, (FRAMES, POINTS))
    direction = unit(azimuth, elevation)
    motion = np.broadcast_to(velocity, (FRAMES, 3))
    doppler = -np.einsum("fpi,fi->fp", direction, motion)
    doppler += noise_mps * random.standard_normal(doppler.shape)
    u, w = direction[..., 1], direction[..., 2] + np.sin(np.radians(tilt_deg))
    measured = np.stack([np.sqrt(1 - u**2 - w**2), u, w], -1)
    distance = random.uniform(1, 10, (FRAMES, POINTS, 1))
    return PointCloud(
        xyz=np.float32(distance * measured),
        valid=np.ones((FRAMES, POINTS), bool),
        power=np.ones((FRAMES, POINTS), np.float32),
        velocity=np.float32(doppler),
    )


def degrees(sine):
    return np.degrees(np.arcsin(sine))


@pytest.mark.parametrize(
    ("velocity", "tilt_deg"), [((1.2, 0.3, 0.0), -12.0), ((-0.8, 0.0, 0.0), 9.3)]
)
def test_the_tilt_is_found_ahead_and_back(velocity, tilt_deg):
    found = level_tilt(seen(velocity, tilt_deg), CHIP)
    assert degrees(found.sine) == pytest.approx(tilt_deg, abs=0.2)
    assert found.frames == FRAMES and degrees(found.deviation) < 0.2


def test_steps_up_and_down_average_out_and_show_in_the_deviation():
    climbs = 0.02 * np.array([-3.0, 2, -1, 0, 0, 1, -2, 3])  # of 1 m/s ahead
    motion = np.stack([np.ones(FRAMES), np.zeros(FRAMES), climbs], -1)
    clouds = seen(motion, 6.0)
    found = level_tilt(clouds, CHIP)
    assert degrees(found.sine) == pytest.approx(6.0, abs=0.3)
    alone = [  # each frame's own, from copies of it
        level_tilt(jax.tree.map(lambda c, k=k: c[[k] * FRAMES], clouds), CHIP).sine
        for k in range(FRAMES)
    ]
    assert np.ptp(alone) > 0.08
    spread = 1.4826 * np.median(np.abs(alone - np.median(alone)))  # of a Gaussian
    expected = np.sqrt(np.pi / 2) * spread / np.sqrt(FRAMES)  # of its median
    assert found.deviation == pytest.approx(expected, rel=1e-4)


def test_velocities_beyond_the_unambiguous_one_are_folded_back():
    most = CHIP.max_velocity_mps
    cloud = seen((1.2 * most, 0.2, 0.0), 6.0, noise_mps=0.02)
    aliased = cloud._replace(velocity=(cloud.velocity + most) % (2 * most) - most)
    assert degrees(level_tilt(aliased, CHIP).sine) == pytest.approx(6.0, abs=0.5)


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


@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.2, 1, 0.0)])
def test_without_motion_ahead_or_with_one_row_nothing_is_said(velocity):
    with pytest.raises(ValueError, match="0 of 8 frames show the tilt, expected 5"):
        level_tilt(seen(velocity, 5.0), CHIP)
    with pytest.raises(ValueError, match="one row of antennas"):
        level_tilt(seen(velocity, 5.0), RadarSpec.awr1642())


def test_invalid_points_do_not_count():
    cloud = seen((1.0, 0.0, 0.0), 5.0)
    others = PointCloud(-cloud.xyz, ~cloud.valid, 9 * cloud.velocity, cloud.power)
    false = jax.tree.map(lambda *both: np.concatenate(both, 1), cloud, others)
    assert degrees(level_tilt(false, CHIP).sine) == pytest.approx(5.0, abs=0.3)


def test_a_tilt_that_does_not_stand_out_is_refused():
    for degrees_, deviation, refused in (
        (6.3, 3.6, True),
        (6.3, 1.2, False),
        (0.1, 0.3, False),
    ):
        tilt = Tilt(*np.sin(np.radians([degrees_, deviation])), 8)
        if refused:
            with pytest.raises(
                ValueError, match="tilt is 6.3 degrees with a deviation of 3"
            ):
                _check_tilt(tilt)
        else:
            _check_tilt(tilt)
