"""Heun: the scan equals the loop, order 2 on Gaussian data, one-step estimate."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.diffusion import (
    NoiseSpec,
    conditional_denoiser,
    heun,
    heun_step,
    karras_sigmas,
    sample,
)
from tests.diffusion.networks import build, shaken

NOISE = NoiseSpec()
SPREAD, MEAN = 0.5, 0.3


def gaussian(x, sigma):
    """The optimal denoiser of independent N(MEAN, SPREAD^2) pixels."""
    return MEAN + SPREAD**2 / (SPREAD**2 + sigma**2) * (x - MEAN)


def exact(x, sigma):
    """Where the ODE takes x from level sigma to level 0."""
    return MEAN + SPREAD / np.sqrt(SPREAD**2 + sigma**2) * (x - MEAN)


def test_sampling_under_jit_equals_the_loop_over_steps():
    network, params, (_, _, condition) = build()
    params = shaken(params)
    key = jax.random.key(1)

    @jax.jit
    def draw(params):
        denoise = conditional_denoiser(network, params, NOISE)(condition)
        return sample(key, denoise, (2, 8, 32, 2), noise=NOISE)

    denoise = conditional_denoiser(network, params, NOISE)(condition)
    sigmas = karras_sigmas(18, NOISE)
    x = NOISE.sigma_max * jax.random.normal(key, (2, 8, 32, 2))
    step = jax.jit(lambda x, a, b: heun_step(denoise, x, a, b))
    for sigma, after in zip(sigmas[:-1], sigmas[1:], strict=True):
        x = step(x, jnp.float32(sigma), jnp.float32(after))
    expected = jax.jit(denoise)(x, sigmas[-1])
    np.testing.assert_allclose(draw(params), expected, atol=1e-5)


def test_error_falls_with_the_square_of_the_step():
    start = jnp.linspace(-100.0, 100.0, 64).reshape(1, 8, 8, 1)
    with jax.enable_x64(True):
        start = start.astype(jnp.float64)
        errors = []
        for steps in (20, 40, 80):
            sigmas = karras_sigmas(steps, NOISE)
            # To the last level only: the denoised end would add an error of its own.
            x = start
            for sigma, after in zip(sigmas[:-1], sigmas[1:], strict=True):
                x = heun_step(gaussian, x, jnp.float64(sigma), jnp.float64(after))
            truth = (
                MEAN
                + (exact(start, sigmas[0]) - MEAN)
                * np.sqrt(SPREAD**2 + sigmas[-1] ** 2)
                / SPREAD
            )
            errors.append(float(jnp.abs(x - truth).max()))
    ratios = np.array(errors[:-1]) / np.array(errors[1:])
    np.testing.assert_allclose(np.log2(ratios), 2, atol=0.25)


def test_samples_have_the_mean_and_spread_of_the_data():
    key, shape = jax.random.key(0), (64, 16, 16, 1)
    images = sample(key, gaussian, shape, noise=NOISE, steps=80)
    np.testing.assert_allclose(images.mean(), MEAN, atol=0.02)
    np.testing.assert_allclose(images.std(), SPREAD, rtol=0.02)


def test_one_step_is_nearly_the_mean():
    images = sample(jax.random.key(0), gaussian, (4, 8, 8, 1), noise=NOISE, steps=1)
    np.testing.assert_allclose(images, MEAN, atol=0.02)


@pytest.mark.parametrize("steps", [2, 18])
def test_n_levels_cost_2_n_minus_1_evaluations(steps):
    calls = []

    def counting(x, sigma):
        calls.append(sigma)
        return gaussian(x, sigma)

    with jax.disable_jit():
        heun(counting, jnp.ones((1, 2, 2, 1)), karras_sigmas(steps, NOISE))
    assert len(calls) == 2 * steps - 1
