"""Regression: the estimate is the network's output; the mean has the least loss."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.diffusion import (
    NoiseSpec,
    precondition,
    regression_estimate,
    regression_loss,
)

NOISE = NoiseSpec(sigma_data=0.5)
KEY = jax.random.key(0)


def constant(image):
    """A denoiser whose network makes the estimate `image`."""
    return precondition(lambda x, c_noise: image / NOISE.sigma_data, NOISE)


def test_the_estimate_is_the_networks_output():
    image = jnp.arange(8.0).reshape(1, 2, 4, 1)
    found = regression_estimate(constant(image), image.shape, noise=NOISE)
    np.testing.assert_allclose(found, image, rtol=1e-4)


def test_the_mean_of_all_answers_has_the_least_squared_error():
    rng = np.random.default_rng(0)
    clean = rng.integers(-8, 9, size=(64, 2, 2, 1)).astype(np.float32) / 8
    gradient = jax.grad(
        lambda image: regression_loss(KEY, constant(image), clean, noise=NOISE)
    )
    mean = jnp.asarray(clean.mean(0, keepdims=True))
    np.testing.assert_allclose(gradient(mean), 0, atol=1e-6)


def test_the_range_counts_as_in_the_denoising_loss():
    clean = jnp.zeros((1, 2, 2, 2))
    off = jnp.broadcast_to(jnp.array([0.3, 0.1]), clean.shape)
    loss = regression_loss(KEY, constant(off), clean, noise=NOISE, range_weight=4.0)
    assert float(loss) == pytest.approx((1.6 * 0.09 + 0.4 * 0.01) / 2, rel=1e-4)
