"""Solvers against Gaussian data, whose best denoiser and ODE have a closed form."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.diffusion import SOLVERS, NoiseSpec, sample
from jradar.diffusion.noise import karras_sigmas
from jradar.diffusion.solvers import HEUN, solver_for

NOISE = NoiseSpec()
SPREAD, MEAN = 0.5, 0.3
KINDS = ["heun", "ipndm4"]  # that have code of their own


def gaussian(x, sigma):
    """The optimal denoiser of independent N(MEAN, SPREAD^2) pixels."""
    return MEAN + SPREAD**2 / (SPREAD**2 + sigma**2) * (x - MEAN)


@functools.cache
def error(name, steps):
    """Largest error at the last level, before it is denoised."""
    with jax.enable_x64(True):
        start = jnp.linspace(-100.0, 100.0, 16).reshape(4, 4, 1)
        sigmas = karras_sigmas(steps, NOISE)
        result = SOLVERS[name].solve(gaussian, start, sigmas)
        end = MEAN + (result - MEAN) * (SPREAD**2 + sigmas[-1] ** 2) / SPREAD**2
        ratio = (SPREAD**2 + sigmas[-1] ** 2) / (SPREAD**2 + sigmas[0] ** 2)
        return float(abs(end - MEAN - np.sqrt(ratio) * (start - MEAN)).max())


@pytest.mark.parametrize(
    ("name", "order"), [("euler", 1), ("heun", 2), ("ipndm2", 2), ("ipndm4", 2)]
)
def test_error_falls_with_the_order(name, order):
    slope = np.log2(error(name, 160) / error(name, 80))
    assert slope == pytest.approx(-order, abs=0.15)


def test_multistep_solvers_are_better_for_the_same_evaluations():
    heun = error("heun", 20)  # 39 evaluations
    assert error("ipndm4", 39) < heun / 4 and error("ipndm4", 20) < heun


COVARIANCE = np.array([[0.30, 0.12, 0.0], [0.12, 0.20, -0.08], [0.0, -0.08, 0.10]])
MEANS = np.array([0.5, -0.2, 0.1])


def correlated(x, sigma):
    """The optimal denoiser of images of three correlated pixels."""
    total = COVARIANCE + sigma**2 * jnp.eye(3)
    shift = x[..., 0] - MEANS[None, None]
    return (MEANS[None, None] + shift @ jnp.linalg.solve(total, COVARIANCE))[..., None]


@pytest.mark.parametrize("name", KINDS)
def test_samples_have_the_mean_and_covariance_of_the_data(name):
    options = {"noise": NOISE, "steps": 40, "solver": SOLVERS[name]}
    draw = jax.jit(lambda key: sample(key, correlated, (20_000, 1, 3, 1), **options))
    images = np.asarray(draw(jax.random.key(0))).reshape(-1, 3)
    np.testing.assert_allclose(images.mean(0), MEANS, atol=0.02)
    np.testing.assert_allclose(np.cov(images.T), COVARIANCE, atol=0.012)


def test_temperature_narrows_what_is_drawn_about_its_mean():
    # The ODE of Gaussian data is linear: deviations shrink by the same factor.
    draw = jax.jit(
        lambda t: sample(
            jax.random.key(0), gaussian, (64, 8, 8, 1), noise=NOISE, steps=40,
            temperature=t,
        )
    )  # fmt: skip
    wide, narrow = draw(1.0), draw(0.5)
    np.testing.assert_allclose(narrow - MEAN, 0.5 * (wide - MEAN), atol=5e-3)
    assert float(narrow.std()) == pytest.approx(0.5 * SPREAD, rel=0.02)


def test_sampling_under_jit_equals_the_loop_over_steps():
    def denoise(x, sigma):
        return jnp.tanh(jnp.roll(x, 1, -2)) / (1 + sigma)

    key = jax.random.key(1)
    draw = jax.jit(lambda key: sample(key, denoise, (2, 8, 8, 2), noise=NOISE))
    sigmas = karras_sigmas(18, NOISE)
    x = NOISE.sigma_max * jax.random.normal(key, (2, 8, 8, 2))
    for sigma, after in zip(sigmas[:-1], sigmas[1:], strict=True):
        slope = (x - denoise(x, sigma)) / sigma
        euler = x + (after - sigma) * slope
        x += (after - sigma) * (slope + (euler - denoise(euler, after)) / after) / 2
    np.testing.assert_allclose(draw(key), denoise(x, sigmas[-1]), atol=1e-5)


@pytest.mark.parametrize("steps", [2, 3, 7])
def test_few_steps_of_the_default_spread_no_wider_than_the_data(steps):
    def drawn(**options):
        shape = (1, 32, 32, 1)
        key, options = jax.random.key(0), {"noise": NOISE, "steps": steps, **options}
        return np.asarray(sample(key, gaussian, shape, **options))

    assert drawn().std() < SPREAD < drawn(solver=HEUN).std() / 1.3
    np.testing.assert_array_equal(drawn(), drawn(solver=SOLVERS["ipndm3"]))


def test_many_steps_are_heuns():
    assert solver_for(7) is SOLVERS["ipndm3"] and solver_for(8) is HEUN


@pytest.mark.parametrize("solver", SOLVERS.values(), ids=SOLVERS)
def test_one_step_is_nearly_the_mean(solver):
    options = {"noise": NOISE, "steps": 1, "solver": solver}
    images = sample(jax.random.key(0), gaussian, (4, 8, 8, 1), **options)
    np.testing.assert_allclose(images, MEAN, atol=0.02)


@pytest.mark.parametrize("name", KINDS)
def test_evaluations_of_n_levels(name):
    calls, solver = [], SOLVERS[name]

    def counting(x, sigma):
        calls.append(sigma)
        return gaussian(x, sigma)

    with jax.disable_jit():
        solver.solve(counting, jnp.ones((1, 2, 2, 1)), karras_sigmas(6, NOISE))
    assert len(calls) == (11 if solver is HEUN else 6)
