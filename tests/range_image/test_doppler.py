"""Velocities of a dense image: those of radar points near in angle and in range."""

import jax.numpy as jnp
import numpy as np
import pytest

from jradar.range_image import ImageSpec, pixel_of, unproject, velocity_image
from jradar.types import PointCloud

COARSE, FINE = ImageSpec(16, 16), ImageSpec(32, 128)
WALL = jnp.full(FINE.shape, 4.0)


def radar(*points):
    """A radar's cloud of (row, column of the coarse image, range, velocity)."""
    image = np.zeros((len(points), *COARSE.shape), np.float32)
    for k, (row, column, range_m, _) in enumerate(points):
        image[k, row, column] = range_m
    cloud = unproject(jnp.asarray(image).reshape(-1, *COARSE.shape), COARSE)
    return PointCloud(
        cloud.xyz.reshape(-1, 3),
        cloud.valid.reshape(-1),
        velocity=jnp.repeat(jnp.array([p[3] for p in points]), 256),
        power=jnp.ones(256 * len(points)),
    )


def test_a_walker_before_a_wall_keeps_the_walls_velocity_apart():
    cloud = radar((8, 4, 4.1, 0.0), (8, 5, 2.5, -1.2))
    image = WALL.at[16:18, 40:48].set(2.4)
    velocity = velocity_image(image, cloud, COARSE, num_slices=8)
    np.testing.assert_allclose(velocity[16:18, 40:48], -1.2)
    np.testing.assert_allclose(velocity[16:18, 32:40], 0.0)


def test_the_nearest_in_angle_wins_and_nothing_is_known_far_from_all():
    seen = radar((8, 4, 4.0, 0.7), (8, 7, 4.1, -0.3))
    velocity = np.asarray(velocity_image(WALL, seen, COARSE, num_slices=8))
    expected = np.full(FINE.shape, np.nan)  # two coarse pixels to each side
    expected[12:22, 16:48], expected[12:22, 48:80] = 0.7, -0.3  # 2:1 in the middle
    np.testing.assert_allclose(velocity, expected)
    deeper = velocity_image(WALL + 0.6, seen, COARSE, num_slices=8)
    assert np.isnan(deeper).all()
    near = radar((8, 4, 0.2, 0.7), (8, 7, 0.2, 0.7))
    assert np.isnan(velocity_image(0 * WALL, near, COARSE, num_slices=8)).all()


def test_unusable_input_is_refused():
    cloud = radar((8, 4, 4.0, 0.7))
    with pytest.raises(ValueError, match="has no velocity"):
        velocity_image(WALL, cloud._replace(velocity=None), COARSE, num_slices=8)
    with pytest.raises(ValueError, match="30 x 128 pixels, expected a multiple"):
        velocity_image(WALL[:30], cloud, COARSE, num_slices=8)
    assert pixel_of(cloud.xyz, COARSE)[3].any()
