"""Losses of pixels from 0 to 1: Bayes' rule, minima, Dice."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.diffusion import OCCUPANCY, NoiseSpec, precondition
from jradar.diffusion.occupancy import prior
from jradar.diffusion.occupancy_losses import (
    SHARE,
    dice_loss,
    estimate_loss,
    log_odds_loss,
    occupancy_loss,
)

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
        return occupancy_loss(KEY, denoise, clean, noise=noise)

    start = jnp.zeros_like(clean)
    np.testing.assert_allclose(loss(start), 1, rtol=0.03)
    assert loss(6 * clean - 3) < 0.5
    less, more = loss(start - 0.1), loss(start + 0.1)
    assert abs(more - less) < 4e-3  # the prior is the best constant


def occupied(share):
    """A denoiser whose estimate is this share of occupied pixels."""
    odds = jnp.log(share / (1 - share)) - prior(RARE)
    return precondition(lambda x, c_noise: odds, RARE)


def test_dice_loss_is_squared_error_and_dice():
    truth = jnp.array([1.0, 0.0, 0.0, 0.0]).reshape(1, 2, 2, 1)
    shares = np.array([0.8, 0.3, 0.1, 0.2])
    dice = 1 - 2 * 0.8 / (shares.sum() + 1)
    squared = (0.2**2 + 0.3**2 + 0.1**2 + 0.2**2) / 4
    denoise = occupied(jnp.asarray(shares).reshape(truth.shape))
    loss = dice_loss(KEY, denoise, truth, noise=RARE)
    assert float(loss) == pytest.approx(dice + squared, rel=1e-4)
    perfect = occupied(jnp.clip(truth, 1e-6, 1 - 1e-6))
    loss = dice_loss(KEY, perfect, truth, noise=RARE)
    assert float(loss) == pytest.approx(0, abs=1e-4)
    empty = jnp.zeros_like(truth)

    @jax.jit
    @jax.value_and_grad
    def nothing_there(share):
        return dice_loss(KEY, occupied(share), empty, noise=RARE)

    value, slope = nothing_there(jnp.full_like(empty, 0.5))
    assert float(value) == pytest.approx(1.25) and np.isfinite(slope).all()


def constant(value):
    """A network that returns the value everywhere."""
    return lambda x, _: jnp.full(x.shape, value)


@pytest.mark.parametrize("loss_of", [estimate_loss, log_odds_loss])
def test_the_loss_is_least_for_the_expected_share(loss_of):
    shares = jax.random.uniform(KEY, (4, 8, 8, 2), maxval=0.2)
    wanted = float(shares.mean())

    def loss(value):
        odds = jnp.log(value / (1 - value))
        if loss_of is log_odds_loss:
            denoise = constant(odds - jnp.log(SHARE / (1 - SHARE)))
        else:
            denoise = precondition(constant(odds - prior(RARE)), RARE)
        return float(loss_of(KEY, denoise, shares, noise=RARE))

    less, least, more = (loss(part * wanted) for part in (0.9, 1.0, 1.1))
    assert min(less, more) > least
    assert less - least == pytest.approx(more - least, rel=0.2)
