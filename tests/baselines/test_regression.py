"""Regression: minima of the losses are where they should be, found by a constant."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.baselines import (
    occupancy_loss,
    regression_estimate,
    regression_loss,
)
from jradar.diffusion import NoiseSpec, precondition
from jradar.diffusion.precondition import prior

NOISE = NoiseSpec(sigma_data=0.5)
RARE = NoiseSpec(prediction="occupancy", sigma_data=0.1, sigma_max=1e4)
KEY = jax.random.key(0)


def answer(image):
    """A denoiser whose network says what makes the estimate `image`."""
    return precondition(lambda x, c_noise: image / NOISE.sigma_data, NOISE)


def test_the_estimate_is_the_networks_output():
    image = jnp.arange(8.0).reshape(1, 2, 4, 1)
    found = regression_estimate(answer(image), image.shape, noise=NOISE)
    np.testing.assert_allclose(found, image, rtol=1e-4)


def test_the_mean_of_all_answers_has_the_least_squared_error():
    clean = jax.random.normal(KEY, (64, 2, 2, 1))
    gradient = jax.grad(
        lambda image: regression_loss(KEY, answer(image), clean, noise=NOISE)
    )
    np.testing.assert_allclose(gradient(clean.mean(0, keepdims=True)), 0, atol=1e-6)


def test_the_range_counts_as_in_the_denoising_loss():
    clean = jnp.zeros((1, 2, 2, 2))
    off = jnp.broadcast_to(jnp.array([0.3, 0.1]), clean.shape)
    loss = regression_loss(KEY, answer(off), clean, noise=NOISE, range_weight=4.0)
    assert float(loss) == pytest.approx((1.6 * 0.09 + 0.4 * 0.01) / 2, rel=1e-4)


def occupied(share):
    """A denoiser whose estimate is this share of occupied pixels."""
    odds = jnp.log(share / (1 - share)) - prior(RARE)
    return precondition(lambda x, c_noise: odds, RARE)


def test_occupancy_loss_is_zero_for_the_truth_and_finite_for_nothing():
    truth = jax.random.bernoulli(KEY, 0.1, (3, 8, 8, 1)).astype(float)
    sure = jnp.clip(truth, 1e-6, 1 - 1e-6)
    perfect = occupancy_loss(KEY, occupied(sure), truth, noise=RARE)
    assert float(perfect) == pytest.approx(0, abs=1e-4)
    empty = jnp.zeros((1, 4, 4, 1))
    value, slope = jax.value_and_grad(
        lambda share: occupancy_loss(KEY, occupied(share), empty, noise=RARE)
    )(jnp.full_like(empty, 0.5))
    assert float(value) == pytest.approx(1.25) and np.isfinite(slope).all()


def test_occupancy_loss_is_squared_error_and_dice():
    truth = jnp.array([1.0, 0.0, 0.0, 0.0]).reshape(1, 2, 2, 1)
    shares = np.array([0.8, 0.3, 0.1, 0.2])
    dice = 1 - 2 * 0.8 / (shares.sum() + 1)
    squared = (0.2**2 + 0.3**2 + 0.1**2 + 0.2**2) / 4
    denoise = occupied(jnp.asarray(shares).reshape(truth.shape))
    loss = occupancy_loss(KEY, denoise, truth, noise=RARE)
    assert float(loss) == pytest.approx(dice + squared, rel=1e-4)
