"""Occupancy: Bayes' rule, minima of losses, exact nearness, and what methods draw."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import KDTree

from experiments.configs import radarhd, radarhd_nearness
from experiments.radarhd import model
from experiments.radarhd.model import (
    REACH_M,
    agreed_occupancy,
    denoising_loss,
    nearness,
    nearness_loss,
    regression_loss,
)
from experiments.radarhd.scores import polar_points
from jradar.diffusion import OCCUPANCY, NoiseSpec, precondition, write_params
from jradar.diffusion.occupancy import prior
from jradar.errors import ModelError
from jradar.planar import LIDAR, RADAR
from tests.experiments.radarhd.conftest import random_params, shrink

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
        return denoising_loss(KEY, denoise, clean, noise=noise)

    start = jnp.zeros_like(clean)
    np.testing.assert_allclose(loss(start), 1, rtol=0.03)
    assert loss(6 * clean - 3) < 0.5
    less, more = loss(start - 0.1), loss(start + 0.1)
    assert abs(more - less) < 4e-3  # the prior is the best constant


def occupied(share):
    """A denoiser whose estimate is this share of occupied pixels."""
    odds = jnp.log(share / (1 - share)) - prior(RARE)
    return precondition(lambda x, c_noise: odds, RARE)


def test_regression_loss_is_squared_error_and_dice():
    truth = jnp.array([1.0, 0.0, 0.0, 0.0]).reshape(1, 2, 2, 1)
    shares = np.array([0.8, 0.3, 0.1, 0.2])
    dice = 1 - 2 * 0.8 / (shares.sum() + 1)
    squared = (0.2**2 + 0.3**2 + 0.1**2 + 0.2**2) / 4
    denoise = occupied(jnp.asarray(shares).reshape(truth.shape))
    loss = regression_loss(KEY, denoise, truth, noise=RARE)
    assert float(loss) == pytest.approx(dice + squared, rel=1e-4)
    perfect = occupied(jnp.clip(truth, 1e-6, 1 - 1e-6))
    loss = regression_loss(KEY, perfect, truth, noise=RARE)
    assert float(loss) == pytest.approx(0, abs=1e-4)
    empty = jnp.zeros_like(truth)

    @jax.jit
    @jax.value_and_grad
    def nothing_there(share):
        return regression_loss(KEY, occupied(share), empty, noise=RARE)

    value, slope = nothing_there(jnp.full_like(empty, 0.5))
    assert float(value) == pytest.approx(1.25) and np.isfinite(slope).all()


def test_agreement_is_the_share_of_draws_with_a_pixel_nearby():
    draws = np.zeros((4, 6, 6), np.float32)
    draws[0, 2, 2] = draws[1, 3, 3] = draws[2, 2, 5] = 1
    expected = np.zeros((6, 6))
    expected[2, 2] = expected[3, 3] = 0.5  # one apart, in two of four draws
    expected[2, 5] = 0.25
    batch = np.stack([draws, draws[:, ::-1]], 1)
    both = np.asarray(agreed_occupancy(jnp.asarray(batch)))
    np.testing.assert_allclose(both, [expected, expected[::-1]])


def walls(seed):
    """An occupancy image with single pixels and a piece of a wall."""
    random = np.random.default_rng(seed)
    occupied = np.zeros(LIDAR.shape, bool)
    occupied[tuple(random.integers(0, size, 40) for size in LIDAR.shape)] = True
    occupied[90, 100:300] = occupied[0, 3] = occupied[255, 511] = True
    return occupied


WALLS = np.stack([walls(0), walls(1), np.zeros(LIDAR.shape, bool)])
TRUTH = jnp.asarray(WALLS[..., None], jnp.float32)


def test_nearness_is_that_of_a_nearest_neighbour_search():
    pixels = polar_points(np.ones(LIDAR.shape, bool))
    found = np.asarray(nearness(TRUTH))[..., 0]
    for image, near in zip(WALLS[:2], found[:2], strict=True):
        apart, _ = KDTree(polar_points(image)).query(pixels)
        expected = np.maximum(1 - apart / REACH_M, 0).reshape(LIDAR.shape)
        np.testing.assert_allclose(near, expected, atol=1e-5)
    assert not found[2].any()
    with pytest.raises(ValueError, match=r"8 x 8 pixels, expected \(256, 512\)"):
        nearness(jnp.zeros((1, 8, 8, 1)))


def test_the_loss_is_least_for_the_expected_nearness():
    wanted = float(nearness(TRUTH).mean())

    def loss(value):
        odds = jnp.log(value / (1 - value)) - prior(RARE)
        denoise = precondition(lambda x, c_noise: odds * jnp.ones_like(x), RARE)
        return float(nearness_loss(KEY, denoise, TRUTH, noise=RARE))

    less, least, more = (loss(part * wanted) for part in (0.9, 1.0, 1.1))
    assert min(less, more) > least
    assert less - least == pytest.approx(more - least, rel=0.2)


def test_the_mean_with_the_mirror_image_is_a_mirror_image_itself():
    weight = np.random.default_rng(0).uniform(size=(1, 4, 6))
    condition = np.random.default_rng(1).uniform(size=(3, 4, 6, 1))

    def both(condition):
        drawn = model.nearness_answers(lambda _, c: c[..., 0] * weight, KEY, condition)
        return dict(drawn)["one pass and its mirror image"]

    found = both(condition)
    np.testing.assert_allclose(both(condition[:, :, ::-1]), found[:, :, ::-1])
    even = condition[..., 0] * (weight + weight[..., ::-1]) / 2
    np.testing.assert_allclose(found, even)


@pytest.mark.slow
def test_draws_agree_and_are_averaged_with_nearness(tmp_path, monkeypatch):
    config, other = shrink(radarhd.get_config()), shrink(radarhd_nearness.get_config())
    other.data.history = 1
    params, near = random_params(config), random_params(other)
    write_params(tmp_path / "near.safetensors", near, dtype=np.float32)
    config.nearness.weights = str(tmp_path / "near.safetensors")
    monkeypatch.setattr(model, "QUICK_STEPS", config.sampling.steps)
    condition = jax.random.uniform(KEY, (1, *RADAR.shape, 1))
    found = dict(model.answers(config, params)(KEY, condition))
    network, noise = model.networks(config)
    fixed = {"params": params, "network": network, "noise": noise, "steps": 2}
    first, second = jax.random.split(KEY)
    straight = model.draw_images(first, condition, **fixed)
    flipped = model.draw_images(second, condition[:, :, ::-1], **fixed)[..., ::-1]
    agreed = agreed_occupancy(jnp.stack([straight, flipped]))
    np.testing.assert_array_equal(found["2 draws"], agreed)
    *_, (_, mirrored) = model.answers(other, near)(KEY, condition)
    mean = (agreed + mirrored) / 2
    np.testing.assert_allclose(found["2 draws and nearness"], mean, atol=1e-6)
    names = ["one-step estimate", "one pass from zero", "diffusion, iPNDM 2"]
    assert [*found] == [*names, "2 draws", "2 draws and nearness"]
    config.data.history = 2
    with pytest.raises(ModelError, match="data.history = 2: .*differ"):
        model.answers(config, params)
