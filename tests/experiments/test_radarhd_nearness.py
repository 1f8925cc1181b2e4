"""Nearness: exact distances in the plane, the minimum of its loss, mirror images."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import KDTree

from experiments.radarhd.nearness import (
    REACH_M,
    mirrored,
    nearness,
    nearness_loss,
)
from experiments.radarhd.occupancy import OCCUPANCY, prior
from experiments.radarhd.pairs import LIDAR, polar_to_points
from jradar.diffusion import NoiseSpec, precondition

KEY = jax.random.key(0)
NOISE = NoiseSpec(prediction=OCCUPANCY, sigma_data=0.1, sigma_max=1e4)


def walls(seed, count=40):
    """An occupancy image with single pixels and a piece of a wall."""
    random = np.random.default_rng(seed)
    occupied = np.zeros(LIDAR.shape, bool)
    rows, columns = (random.integers(0, size, count) for size in LIDAR.shape)
    occupied[rows, columns] = True
    occupied[90, 100:300] = occupied[0, 3] = occupied[255, 511] = True
    return occupied


def test_nearness_is_that_of_a_nearest_neighbour_search():
    images = np.stack([walls(seed) for seed in range(2)])
    pixels = polar_to_points(np.ones(LIDAR.shape, bool))
    found = nearness(jnp.asarray(images[..., None], jnp.float32))
    for image, near in zip(images, np.asarray(found)[..., 0], strict=True):
        apart, _ = KDTree(polar_to_points(image)).query(pixels)
        expected = np.maximum(1 - apart / REACH_M, 0).reshape(LIDAR.shape)
        np.testing.assert_allclose(near, expected, atol=1e-5)


def test_nothing_is_near_in_an_empty_image():
    assert not np.any(nearness(jnp.zeros((1, *LIDAR.shape, 1))))
    with pytest.raises(ValueError, match=r"8 x 8 pixels, expected \(256, 512\)"):
        nearness(jnp.zeros((1, 8, 8, 1)))


def test_the_loss_is_least_for_the_expected_nearness():
    truth = jnp.asarray(walls(0)[None, ..., None], jnp.float32)
    wanted = float(nearness(truth).mean())

    def loss(value):
        odds = jnp.log(value / (1 - value)) - prior(NOISE)
        denoise = precondition(lambda x, c_noise: odds * jnp.ones_like(x), NOISE)
        return nearness_loss(KEY, denoise, truth, noise=NOISE)

    slope = jax.grad(loss)
    assert float(slope(wanted)) == pytest.approx(0, abs=1e-2)
    assert float(slope(0.8 * wanted)) < -0.1 and float(slope(1.2 * wanted)) > 0.1


def test_the_mean_with_the_mirror_image_is_a_mirror_image_itself():
    weight = np.random.default_rng(0).uniform(size=(1, 4, 6))

    def draw(_key, condition):
        return condition[..., 0] * weight

    condition = np.random.default_rng(1).uniform(size=(3, 4, 6, 1))
    found = np.asarray(mirrored(draw, KEY, condition))
    other = np.asarray(mirrored(draw, KEY, condition[:, :, ::-1]))
    np.testing.assert_allclose(other, found[:, :, ::-1])
    even = condition[..., 0] * (weight + weight[..., ::-1]) / 2
    np.testing.assert_allclose(found, even)
