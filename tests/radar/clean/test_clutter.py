"""Background: what stands still goes, also when its phase drifts; a walker stays."""

import jax.numpy as jnp
import numpy as np
import pytest

from jradar.radar import power_map, static_background, subtract_background
from tests.radar.targets import SMALL, simulate, target

WALL = target(3.0, 10, 0, 0.0, amplitude=300.0)
FRAMES = [np.asarray(simulate(WALL, seed=i)) for i in range(20)]
BACKGROUND = static_background(FRAMES)
NOW = np.asarray(simulate(WALL, seed=98))


def peak(cube, distance, velocity):
    """Largest power near a target's cell."""
    row = 16 + round(velocity / SMALL.velocity_resolution_mps)
    column = round(distance / SMALL.range_resolution_m)
    near = slice(row - 1, row + 2), slice(column - 1, column + 2)
    return float(np.asarray(power_map(cube))[near].max())


@pytest.mark.parametrize("velocity", [1.2, 0.0], ids=["walking", "standing"])
def test_the_wall_goes_and_a_person_before_empty_background_stays(velocity):
    both = NOW + simulate(target(4.5, -20, 3, velocity, amplitude=30.0), seed=99)
    left = subtract_background(both, BACKGROUND)
    assert peak(left, 3.0, 0.0) < 1e-4 * peak(both, 3.0, 0.0)
    found = peak(both, 4.5, velocity)
    assert peak(left, 4.5, velocity) == pytest.approx(found, rel=0.05)
    without_mean = both - both.mean(-2, keepdims=True)  # the frame's own
    assert (peak(without_mean, 4.5, velocity) < 1e-3 * found) == (velocity == 0)


def test_a_phase_that_drifts_is_followed():
    cube = NOW * np.exp(1j * np.linspace(0.05, 0.1, SMALL.num_chirps))[:, None]
    still = cube - np.asarray(BACKGROUND)[:, :, None]
    left = subtract_background(jnp.asarray(cube), BACKGROUND)
    assert peak(still, 3.0, 0.0) > 1e-3 * peak(cube, 3.0, 0.0)
    assert peak(left, 3.0, 0.0) < 1e-4 * peak(cube, 3.0, 0.0)


def test_real_samples_stay_real():
    real = [frame.real for frame in FRAMES]
    left = subtract_background(real[0], static_background(real))
    assert left.dtype == jnp.float32
    assert peak(left, 3.0, 0.0) < 1e-4 * peak(real[0], 3.0, 0.0)


def test_a_background_of_nothing_changes_nothing():
    left = subtract_background(NOW, jnp.zeros_like(BACKGROUND))
    np.testing.assert_array_equal(left, NOW)


def test_what_is_no_background_is_refused():
    with pytest.raises(ValueError, match="there are none"):
        static_background([])
    with pytest.raises(ValueError, match=r"\(3, 4, 32\), the cube needs .*\(3, 4, 64"):
        subtract_background(NOW, BACKGROUND[..., :32])
