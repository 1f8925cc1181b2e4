"""Occupancy: the posterior by Bayes' rule, and the minima of the losses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.radarhd.occupancy import (
    OCCUPANCY,
    agreed_occupancy,
    occupancy_denoising_loss,
    occupancy_regression_loss,
    prior,
)
from jradar.diffusion import NoiseSpec, precondition

RARE = NoiseSpec(prediction=OCCUPANCY, sigma_data=0.1, sigma_max=1e4)
KEY = jax.random.key(0)


def test_occupancy_is_the_posterior_of_a_pixel_that_is_0_or_1():
    share, sigma, x = 0.09, 0.4, 0.7
    noise = NoiseSpec(prediction=OCCUPANCY, sigma_data=(share * (1 - share)) ** 0.5)
    denoise = precondition(lambda x, c_noise: jnp.full_like(x, 0.8), noise)
    odds = share / (1 - share) * np.exp(0.8)
    odds *= np.exp(-((x - 1) ** 2) / (2 * sigma**2) + x**2 / (2 * sigma**2))
    found = denoise(jnp.full((1, 1, 1, 1), x), sigma)
    np.testing.assert_allclose(found, odds / (1 + odds), rtol=1e-5)
    with pytest.raises(ValueError, match="sigma_data = 0.7, expected at most 0.5"):
        NoiseSpec(prediction=OCCUPANCY, sigma_data=0.7)


def test_cross_entropy_is_1_for_the_prior_and_falls_with_knowledge():
    share = 0.09
    noise = NoiseSpec(
        prediction=OCCUPANCY,
        sigma_data=(share * (1 - share)) ** 0.5,
        log_mean=7.0,  # noise so strong that pixels carry no information
        log_std=0.1,
    )
    clean = jax.random.bernoulli(KEY, share, (64, 32, 32, 1)).astype(float)

    @jax.jit
    def loss(odds):
        denoise = precondition(lambda x, c_noise: odds, noise)
        return occupancy_denoising_loss(KEY, denoise, clean, noise=noise)

    np.testing.assert_allclose(loss(jnp.zeros_like(clean)), 1, rtol=0.03)
    assert loss(6 * clean - 3) < 0.5
    slope = jax.grad(lambda shift: loss(shift * jnp.ones_like(clean)))(0.0)
    assert abs(slope) < 0.02  # the prior is the best constant


def occupied(share):
    """A denoiser whose estimate is this share of occupied pixels."""
    odds = jnp.log(share / (1 - share)) - prior(RARE)
    return precondition(lambda x, c_noise: odds, RARE)


def test_regression_loss_is_zero_for_the_truth_and_finite_for_nothing():
    truth = jax.random.bernoulli(KEY, 0.1, (3, 8, 8, 1)).astype(float)
    sure = jnp.clip(truth, 1e-6, 1 - 1e-6)
    perfect = occupancy_regression_loss(KEY, occupied(sure), truth, noise=RARE)
    assert float(perfect) == pytest.approx(0, abs=1e-4)
    empty = jnp.zeros((1, 4, 4, 1))
    value, slope = jax.value_and_grad(
        lambda share: occupancy_regression_loss(KEY, occupied(share), empty, noise=RARE)
    )(jnp.full_like(empty, 0.5))
    assert float(value) == pytest.approx(1.25) and np.isfinite(slope).all()


def test_regression_loss_is_squared_error_and_dice():
    truth = jnp.array([1.0, 0.0, 0.0, 0.0]).reshape(1, 2, 2, 1)
    shares = np.array([0.8, 0.3, 0.1, 0.2])
    dice = 1 - 2 * 0.8 / (shares.sum() + 1)
    squared = (0.2**2 + 0.3**2 + 0.1**2 + 0.2**2) / 4
    denoise = occupied(jnp.asarray(shares).reshape(truth.shape))
    loss = occupancy_regression_loss(KEY, denoise, truth, noise=RARE)
    assert float(loss) == pytest.approx(dice + squared, rel=1e-4)


def test_agreement_is_the_share_of_draws_with_a_pixel_nearby():
    draws = np.zeros((4, 6, 6), np.float32)
    draws[0, 2, 2] = draws[1, 3, 3] = draws[2, 2, 5] = 1
    agreed = np.asarray(agreed_occupancy(jnp.asarray(draws)))
    expected = np.zeros((6, 6))
    expected[2, 2] = expected[3, 3] = 0.5  # one apart, in two of four draws
    expected[2, 5] = 0.25
    np.testing.assert_allclose(agreed, expected)
    alone = np.asarray(agreed_occupancy(jnp.asarray(draws), reach=0))
    np.testing.assert_allclose(alone, draws.mean(0))
    batch = np.stack([draws, draws[:, ::-1]], 1)
    both = np.asarray(agreed_occupancy(jnp.asarray(batch)))
    np.testing.assert_allclose(both, [agreed, agreed[::-1]])
    with pytest.raises(ValueError, match="reach=-1, expected 0 or more"):
        agreed_occupancy(jnp.asarray(draws), reach=-1)
