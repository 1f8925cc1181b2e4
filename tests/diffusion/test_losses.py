"""Eq. 9-12 against the formulas, predictions; regression's loss."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.diffusion import (
    PREDICTIONS,
    LossSpec,
    NoiseSpec,
    denoising_loss,
    precondition,
    regression_estimate,
    regression_loss,
    where_known,
)
from jradar.diffusion.losses import known_share
from jradar.diffusion.noise import training_sigma

KEY, NOISE = jax.random.key(1), NoiseSpec()
CLEAN = jnp.asarray(np.random.default_rng(0).normal(scale=0.5, size=(64, 4, 4, 2)), "f")
SHIFT = jnp.array([0.2, -0.1])[None, None, None]


def shifted(x, sigma):
    """A denoiser that is wrong by 0.2 and -0.1 everywhere."""
    return CLEAN + SHIFT


def mean_square(a, b):
    return ((a - b) ** 2).mean((1, 2, 3))


def loss(weights, denoise=shifted, clean=CLEAN, *, noise=NOISE, **options):
    """`denoising_loss` with these fields of its `LossSpec`, as a number."""
    options = {"perceptual": mean_square, "weights": LossSpec(**weights)} | options
    return float(denoising_loss(KEY, denoise, clean, noise=noise, **options))


@pytest.fixture(scope="module")
def levels():
    """The noise levels that `loss` draws."""
    return np.asarray(training_sigma(jax.random.split(KEY)[0], (64,), NOISE))


# A mixture's outputs are no image: it has the loss of `jradar.diffusion.mixture`.
IMAGES = {name: kind for name, kind in PREDICTIONS.items() if name != "mixture"}


@pytest.mark.parametrize("prediction", IMAGES.values(), ids=IMAGES)
def test_loss_of_a_network_of_zeros_is_1(prediction):
    noise = NoiseSpec(prediction=prediction)
    outputs = prediction.outputs_per_channel
    denoise = precondition(lambda x, _: jnp.zeros((*x.shape[:-1], outputs)), noise)
    rng = np.random.default_rng(0)
    clean = jnp.asarray(rng.normal(scale=0.5, size=(4000, 2, 2, 1)), jnp.float32)
    assert loss({}, denoise, clean, noise=noise) == pytest.approx(1, rel=0.03)


def test_prediction_clean_is_the_network_itself():
    noise = NoiseSpec(prediction=PREDICTIONS["clean"], sigma_data=0.7)
    x, seen = CLEAN[:2], []
    denoise = precondition(lambda x, _: seen.append(x) or 2 * jnp.ones_like(x), noise)
    np.testing.assert_allclose(denoise(x, 0.3), 1.4, rtol=1e-6)
    np.testing.assert_allclose(seen[0], x / np.hypot(0.3, 0.7), rtol=1e-5)


def test_gaussian_is_the_posterior_mean_of_a_pixel_with_that_prior():
    noise = NoiseSpec(prediction=PREDICTIONS["gaussian"], sigma_data=0.5)
    sigma, x = 0.3, 0.3
    mean, spread = 0.15, 0.25  # of the prior of this pixel
    output = jnp.array([mean / 0.5, 4 * np.arctanh(np.log(spread / 0.5) / 4)])
    denoise = precondition(lambda x, c_noise: output[None, None, None], noise)
    grid = np.linspace(-3, 3, 20001)  # Bayes' rule, summed
    weight = np.exp(-((grid - mean) ** 2) / (2 * spread**2))
    weight *= np.exp(-((x - grid) ** 2) / (2 * sigma**2))
    expected = (weight * grid).sum() / weight.sum()
    found = denoise(jnp.full((1, 1, 1, 1), x), sigma)
    np.testing.assert_allclose(found, expected, rtol=1e-4)


def test_terms_are_the_equations(levels):
    weight = ((levels**2 + 0.25) / (levels * 0.5) ** 2).mean()
    squared = weight * (0.2**2 + 0.1**2) / 2
    found = loss({"squared": 0.3, "perceptual": 0.5, "absolute": 0.2})
    expected = 0.3 * squared + 0.5 * 0.2**2 + 0.2 * 0.15  # first channel only in L_p
    assert found == pytest.approx(expected, rel=1e-5)
    square = (1.6 * 0.2**2 + 0.4 * 0.1**2) / 2  # 4 to 1, and 1 on average
    assert loss({"range_weight": 4.0}) == pytest.approx(weight * square, rel=1e-5)


def constant(image):
    """A denoiser whose network makes the estimate `image`."""
    return precondition(lambda x, c_noise: image / NOISE.sigma_data, NOISE)


def test_the_estimate_is_the_networks_output():
    image = jnp.arange(8.0).reshape(1, 2, 4, 1)
    found = regression_estimate(constant(image), image.shape, noise=NOISE)
    np.testing.assert_allclose(found, image, rtol=1e-4)


def test_the_mean_of_all_answers_has_the_least_squared_error():
    rng = np.random.default_rng(0)
    clean = jnp.asarray(rng.integers(-8, 9, size=(64, 2, 2, 1)).astype(np.float32) / 8)
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


@pytest.mark.parametrize(
    ("fields", "options", "message"),
    [
        ({"range_weight": 0.0}, {}, "range_weight = 0.0, expected above 0"),
        ({"squared": -1.0}, {}, "squared = -1.0, expected 0 or more"),
        ({"perceptual": 1.0}, {"perceptual": None}, "perceptual weight 1.0 without"),
        (
            {},
            {"noise": NoiseSpec(prediction=PREDICTIONS["mixture"])},
            "'mixture' gives a dist.*with mixture_loss",
        ),
    ],
)
def test_impossible_losses_are_refused(fields, options, message):
    with pytest.raises(ValueError, match=message):
        loss(fields, **options)


@pytest.mark.parametrize("plain", [denoising_loss, regression_loss])
def test_pixels_that_nobody_observed_have_no_error(plain):
    whole = where_known(plain)
    assert whole(KEY, shifted, CLEAN, noise=NOISE) == pytest.approx(
        float(plain(KEY, shifted, CLEAN, noise=NOISE))
    )
    some = CLEAN.at[:, :2, :, 1].set(0.0)  # of validity 0
    left = float(whole(KEY, shifted, some, noise=NOISE))

    def right_there(x, sigma):
        return jnp.where(some[..., 1:] == 0, some, shifted(x, sigma))

    without = float(plain(KEY, right_there, some, noise=NOISE))
    assert left == pytest.approx(without * CLEAN.shape[1] / (CLEAN.shape[1] - 2))


def test_an_image_with_hardly_a_known_pixel_does_not_outweigh_the_others():
    clean = jnp.zeros((2, 10, 10, 2)).at[0, ..., 1].set(1.0).at[1, 0, 0, 1].set(-1.0)
    np.testing.assert_allclose(known_share(clean), [1.0, 0.05])
