"""Solvers against Gaussian data, whose best denoiser and ODE have a closed form."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.diffusion import (
    SOLVERS,
    NoiseSpec,
    heun_churn,
    heun_step,
    karras_sigmas,
    log_sigmas,
    multistep_table,
    sample,
    solve,
)

NOISE = NoiseSpec()
SPREAD, MEAN = 0.5, 0.3


def gaussian(x, sigma):
    """The optimal denoiser of independent N(MEAN, SPREAD^2) pixels."""
    return MEAN + SPREAD**2 / (SPREAD**2 + sigma**2) * (x - MEAN)


def levels_of(solver):
    return log_sigmas if solver.startswith("dpm++") else karras_sigmas


@functools.cache
def error(solver, steps):
    """Largest error at the last level, which is where the solver's own error ends."""
    with jax.enable_x64(True):
        start = jnp.linspace(-100.0, 100.0, 16).reshape(4, 4, 1)
        sigmas = levels_of(solver)(steps, NOISE)
        end = solve(gaussian, start, sigmas, solver=solver, return_path=True)[-2]
        ratio = (SPREAD**2 + sigmas[-1] ** 2) / (SPREAD**2 + sigmas[0] ** 2)
        return float(abs(end - MEAN - np.sqrt(ratio) * (start - MEAN)).max())


@pytest.mark.parametrize(
    ("solver", "order"),
    [("euler", 1), ("heun", 2), ("ipndm2", 2), ("ipndm4", 2), ("dpm++2m", 2)],
)
def test_error_falls_with_the_order(solver, order):
    steps = [40, 80, 160]
    slope = np.polyfit(np.log(steps), np.log([error(solver, n) for n in steps]), 1)[0]
    assert slope == pytest.approx(-order, abs=0.15)


def test_third_order_falls_at_least_with_the_cube():
    assert error("dpm++3m", 80) < error("dpm++3m", 40) / 2**2.9


def test_multistep_solvers_are_better_for_the_same_evaluations():
    heun = error("heun", 20)  # 39 evaluations
    assert error("ipndm4", 39) < heun / 4 and error("ipndm4", 20) < heun
    assert error("dpm++2m", 39) < heun / 2
    assert error("dpm++3m", 20) < heun / 4


def test_table_integrates_its_polynomials_exactly():
    # Over ln sigma, D = (-ln sigma)^p is a polynomial; dx/dl = D - x by quadrature.
    sigmas = np.array([4.0, 2.5, 1.5, 1.2, 0.4])
    keep, weights = multistep_table(sigmas, solver="dpm++3m")
    times = -np.log(sigmas)
    fine = np.linspace(times[3], times[4], 20_001)
    for degree in range(3):
        integral = np.trapezoid(np.exp(fine - times[4]) * fine**degree, fine)
        assert weights[3] @ times[[3, 2, 1]] ** degree == pytest.approx(integral)
    np.testing.assert_allclose(keep, np.exp(times[:-1] - times[1:]))
    assert not weights[0, 1:].any() and not weights[1, 2:].any()


COVARIANCE = np.array([[0.30, 0.12, 0.0], [0.12, 0.20, -0.08], [0.0, -0.08, 0.10]])
MEANS = np.array([0.5, -0.2, 0.1])


def correlated(x, sigma):
    """The optimal denoiser of images of three correlated pixels."""
    total = COVARIANCE + sigma**2 * jnp.eye(3)
    shift = x[..., 0] - MEANS[None, None]
    return (MEANS[None, None] + shift @ jnp.linalg.solve(total, COVARIANCE))[..., None]


@pytest.mark.parametrize(
    "options",
    [{"solver": solver, "steps": 40} for solver in ("heun", "ipndm4", "dpm++3m")]
    + [
        {"steps": 120, "churn": 30.0, "churn_range": (0.05, 50.0)},
        {"steps": 120, "churn": 100.0, "churn_noise": 1.003},
    ],
    ids=str,
)
def test_samples_have_the_mean_and_covariance_of_the_data(options):
    draw = jax.jit(
        lambda key: sample(key, correlated, (20_000, 1, 3, 1), noise=NOISE, **options)
    )
    images = np.asarray(draw(jax.random.key(0))).reshape(-1, 3)
    np.testing.assert_allclose(images.mean(0), MEANS, atol=0.02)
    np.testing.assert_allclose(np.cov(images.T), COVARIANCE, atol=0.012)


def test_temperature_narrows_what_is_drawn_about_its_mean():
    # The ODE of Gaussian data is linear: deviations shrink by the same factor.
    drawn = [
        sample(jax.random.key(0), gaussian, (64, 8, 8, 1), noise=NOISE, steps=40,
               temperature=t) for t in (1.0, 0.5)
    ]  # fmt: skip
    np.testing.assert_allclose(drawn[1] - MEAN, 0.5 * (drawn[0] - MEAN), atol=5e-3)
    assert float(drawn[1].std()) == pytest.approx(0.5 * SPREAD, rel=0.02)


def test_churn_is_random_and_without_levels_to_churn_is_heun():
    start = 80.0 * jax.random.normal(jax.random.key(0), (2, 4, 4, 1))
    sigmas = karras_sigmas(8, NOISE)

    plain = solve(gaussian, start, sigmas)
    never = heun_churn(
        jax.random.key(1),
        gaussian,
        start,
        sigmas,
        churn=4.0,
        churn_range=(100.0, 200.0),
    )
    np.testing.assert_allclose(never, plain, atol=1e-6)
    always = jax.jit(lambda key: heun_churn(key, gaussian, start, sigmas, churn=4.0))
    one, two = (always(jax.random.key(seed)) for seed in (1, 2))
    assert jnp.abs(one - two).max() > 0.01 < jnp.abs(one - plain).max()


@pytest.mark.parametrize("solver", SOLVERS)
def test_path_leads_from_the_noise_to_the_sample(solver):
    options = {"noise": NOISE, "steps": 5, "solver": solver}
    path = sample(
        jax.random.key(0), gaussian, (2, 4, 4, 1), return_path=True, **options
    )
    assert path.shape == (6, 2, 4, 4, 1)
    start = 80.0 * jax.random.normal(jax.random.key(0), (2, 4, 4, 1))
    np.testing.assert_array_equal(path[0], start)
    end = sample(jax.random.key(0), gaussian, (2, 4, 4, 1), **options)
    np.testing.assert_allclose(path[-1], end, atol=1e-6)
    assert path[1].std() < path[0].std() / 2


def test_sampling_under_jit_equals_the_loop_over_steps():
    def denoise(x, sigma):
        return jnp.tanh(jnp.roll(x, 1, -2)) / (1 + sigma)

    key = jax.random.key(1)
    draw = jax.jit(lambda key: sample(key, denoise, (2, 8, 8, 2), noise=NOISE))
    sigmas = karras_sigmas(18, NOISE)
    x = NOISE.sigma_max * jax.random.normal(key, (2, 8, 8, 2))
    for sigma, after in zip(sigmas[:-1], sigmas[1:], strict=True):
        x = heun_step(denoise, x, jnp.float32(sigma), jnp.float32(after))
    np.testing.assert_allclose(draw(key), denoise(x, sigmas[-1]), atol=1e-5)


@pytest.mark.parametrize("solver", SOLVERS)
def test_one_step_is_nearly_the_mean(solver):
    shape = (4, 8, 8, 1)
    images = sample(
        jax.random.key(0), gaussian, shape, noise=NOISE, steps=1, solver=solver
    )
    np.testing.assert_allclose(images, MEAN, atol=0.02)


@pytest.mark.parametrize("solver", SOLVERS)
def test_evaluations_of_n_levels(solver):
    calls = []

    def counting(x, sigma):
        calls.append(sigma)
        return gaussian(x, sigma)

    with jax.disable_jit():
        solve(counting, jnp.ones((1, 2, 2, 1)), karras_sigmas(6, NOISE), solver=solver)
    assert len(calls) == (11 if solver == "heun" else 6)


def test_unknown_solver_and_churn_elsewhere_are_refused():
    draw = functools.partial(
        sample, jax.random.key(0), gaussian, (1, 2, 2, 1), noise=NOISE
    )
    with pytest.raises(ValueError, match="solver='rk4', expected one of"):
        draw(solver="rk4")
    with pytest.raises(ValueError, match="only Heun's method takes churn"):
        draw(solver="euler", churn=1.0)
