"""Noise levels: EDM's table by hand, unit variance of inputs and targets, errors."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.diffusion import NoiseSpec, precondition
from jradar.diffusion.noise import karras_sigmas, training_sigma
from jradar.diffusion.predictions import EDM, scalings

NOISE = NoiseSpec()


def test_karras_levels_are_equation_5():
    levels = karras_sigmas(18, NOISE)
    assert levels.dtype == np.float64 and len(levels) == 18
    assert levels[0] == pytest.approx(80) and levels[-1] == pytest.approx(0.002)
    root = 80 ** (1 / 7) + 5 / 17 * (0.002 ** (1 / 7) - 80 ** (1 / 7))
    assert levels[5] == pytest.approx(root**7)
    assert karras_sigmas(1, NOISE).tolist() == pytest.approx([80])


@pytest.mark.parametrize("sigma", [0.002, 0.3, 0.5, 80.0])
def test_scalings_keep_unit_variance(sigma):
    c_skip, c_out, c_in, c_noise = scalings(jnp.float32(sigma), NOISE.sigma_data)
    total = sigma**2 + NOISE.sigma_data**2
    np.testing.assert_allclose(c_in**2 * total, 1, rtol=1e-5)  # the input's variance
    # The target (x0 - c_skip x) / c_out of a white image has variance 1.
    error = ((1 - c_skip) * NOISE.sigma_data) ** 2 + (c_skip * sigma) ** 2
    np.testing.assert_allclose(error / c_out**2, 1, rtol=1e-3)
    np.testing.assert_allclose(c_noise, np.log(sigma) / 4, rtol=1e-5)
    weight = EDM.loss_weight(jnp.float32(sigma), NOISE.sigma_data)
    np.testing.assert_allclose(weight * c_out**2, 1, rtol=1e-5)


def test_training_levels_are_log_normal():
    logs = np.log(training_sigma(jax.random.key(0), (20_000,), NOISE))
    np.testing.assert_allclose(logs.mean(), -1.2, atol=0.03)
    np.testing.assert_allclose(logs.std(), 1.2, atol=0.03)


def test_denoiser_is_the_identity_without_noise():
    x = jnp.asarray(np.random.default_rng(0).normal(size=(2, 3, 4, 2)), jnp.float32)
    denoise = precondition(lambda x, c_noise: jnp.ones_like(x), NOISE)
    np.testing.assert_allclose(denoise(x, jnp.full(2, 1e-6)), x, atol=1e-5)


@pytest.mark.parametrize(
    "values",
    [{"sigma_data": 0.0}, {"sigma_min": 1.0, "sigma_max": 0.5}, {"sigma_min": 0.0}],
)
def test_impossible_levels_are_refused(values):
    with pytest.raises(ValueError, match="expected"):
        NoiseSpec(**values)
    with pytest.raises(ValueError, match="steps=0, expected 1"):
        karras_sigmas(0, NOISE)
