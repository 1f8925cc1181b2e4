"""Eq. 9-12 against the formulas, masks, levels and intervals of the extra terms."""

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
    target_mask,
    training_sigma,
)

STATIC = ("denoise", "noise", "weights", "perceptual")
LOSS = jax.jit(denoising_loss, static_argnames=STATIC)
KEY, NOISE = jax.random.key(1), NoiseSpec()
CLEAN = 0.5 * jax.random.normal(jax.random.key(0), (64, 4, 4, 2))
SHIFT = jnp.array([0.2, -0.1])[None, None, None]


def shifted(x, sigma):
    """A denoiser that is wrong by 0.2 and -0.1 everywhere."""
    return CLEAN + SHIFT


def mean_square(a, b):
    return ((a - b) ** 2).mean((1, 2, 3))


# A mixture's outputs are no image: it has the loss of `jradar.diffusion.mixture`.
IMAGES = {name: kind for name, kind in PREDICTIONS.items() if name != "mixture"}


@pytest.mark.parametrize("prediction", IMAGES.values(), ids=IMAGES)
def test_loss_of_a_network_of_zeros_is_1(prediction):
    noise = NoiseSpec(prediction=prediction)
    clean = 0.5 * jax.random.normal(jax.random.key(0), (4000, 2, 2, 1))
    outputs = prediction.outputs_per_channel
    denoise = precondition(
        lambda x, c_noise: jnp.zeros((*x.shape[:-1], outputs)), noise
    )
    loss = LOSS(KEY, denoise, clean, noise=noise)
    np.testing.assert_allclose(loss, 1, rtol=0.03)


def test_prediction_clean_is_the_network_itself():
    noise = NoiseSpec(prediction=PREDICTIONS["clean"], sigma_data=0.7)
    x = jax.random.normal(KEY, (2, 3, 4, 2))
    seen = []
    denoise = precondition(lambda x, c_noise: seen.append(x) or 2 * jnp.ones_like(x),
                           noise)  # fmt: skip
    np.testing.assert_allclose(denoise(x, 0.3), 1.4, rtol=1e-6)
    np.testing.assert_allclose(seen[0], x / np.hypot(0.3, 0.7), rtol=1e-5)


def test_gaussian_is_the_posterior_mean_of_a_pixel_with_that_prior():
    noise = NoiseSpec(prediction=PREDICTIONS["gaussian"], sigma_data=0.5)
    sigma, clean = 0.3, 0.2
    mean, spread = 0.15, 0.25  # of the prior of this pixel
    output = jnp.array([mean / 0.5, 4 * np.arctanh(np.log(spread / 0.5) / 4)])
    denoise = precondition(lambda x, c_noise: output[None, None, None], noise)
    grid = np.linspace(-3, 3, 20001)  # Bayes' rule, summed
    x = clean + 0.1
    weight = np.exp(-((grid - mean) ** 2) / (2 * spread**2))
    weight *= np.exp(-((x - grid) ** 2) / (2 * sigma**2))
    expected = (weight * grid).sum() / weight.sum()
    found = denoise(jnp.full((1, 1, 1, 1), x), sigma)
    np.testing.assert_allclose(found, expected, rtol=1e-4)


def test_terms_are_the_equations():
    sigma = training_sigma(jax.random.split(KEY)[0], (64,), NOISE)
    weight = (sigma**2 + 0.25) / (sigma * 0.5) ** 2
    squared = (weight * (0.2**2 + 0.1**2) / 2).mean()
    spec = LossSpec(squared=0.3, perceptual=0.5, absolute=0.2)
    loss = LOSS(KEY, shifted, CLEAN, noise=NOISE, weights=spec, perceptual=mean_square)
    expected = 0.3 * squared + 0.5 * 0.2**2 + 0.2 * 0.15  # first channel only in L_p
    np.testing.assert_allclose(loss, expected, rtol=1e-5)


def test_the_range_has_its_weight():
    levels = training_sigma(jax.random.split(KEY)[0], (64,), NOISE)
    scale = jnp.mean((levels**2 + 0.25) / (0.5 * levels) ** 2)
    weighted = LOSS(
        KEY, shifted, CLEAN, noise=NOISE, weights=LossSpec(range_weight=4.0)
    )
    square = (1.6 * 0.2**2 + 0.4 * 0.1**2) / 2  # 4 to 1, and 1 on average
    np.testing.assert_allclose(weighted, scale * square, rtol=1e-5)


def test_masked_values_do_not_count():
    mask = jnp.zeros_like(CLEAN).at[:, :2, :, 0].set(1.0)
    spec = LossSpec(squared=0.0, absolute=1.0, perceptual=1.0)
    options = {"noise": NOISE, "weights": spec, "perceptual": mean_square}
    loss = LOSS(KEY, shifted, CLEAN, mask=mask, **options)
    np.testing.assert_allclose(loss, 0.2 + 0.2**2 / 2, rtol=1e-5)

    def broken(x, sigma):
        return jnp.where(mask > 0, shifted(x, sigma), 1e6)

    same = LOSS(KEY, broken, CLEAN, mask=mask, **options)
    np.testing.assert_allclose(same, loss, rtol=1e-5)
    assert LOSS(KEY, shifted, CLEAN, mask=0 * mask, **options) == 0


def test_extra_terms_stop_at_a_level():
    sigma = training_sigma(jax.random.split(KEY)[0], (64,), NOISE)
    spec = LossSpec(squared=0.0, absolute=1.0, below_sigma=0.3)
    loss = LOSS(KEY, shifted, CLEAN, noise=NOISE, weights=spec)
    np.testing.assert_allclose(loss, 0.15 * (sigma < 0.3).mean(), rtol=1e-5)


def test_perceptual_term_is_computed_every_kth_step():
    spec = LossSpec(squared=0.0, perceptual=1.0, perceptual_every=3)
    options = {"noise": NOISE, "weights": spec, "perceptual": mean_square}
    terms = [
        float(LOSS(KEY, shifted, CLEAN, step=step, **options)) for step in range(6)
    ]
    np.testing.assert_allclose(terms, [3 * 0.04, 0, 0] * 2, rtol=1e-5)


def test_a_miss_has_a_validity_but_no_range():
    target = jnp.array([[0.5, 1.0], [0.1, -1.0]])[None, None]
    np.testing.assert_array_equal(target_mask(target)[0, 0], [[1, 1], [0, 1]])


def test_a_distribution_is_refused_because_it_is_no_image():
    noise = NoiseSpec(prediction=PREDICTIONS["mixture"])
    with pytest.raises(ValueError, match="'mixture' gives a dist.*with mixture_loss"):
        LOSS(KEY, shifted, CLEAN, noise=noise)


def test_impossible_weights_are_refused():
    with pytest.raises(ValueError, match="range_weight = 0.0, expected above 0"):
        LossSpec(range_weight=0.0)
    with pytest.raises(ValueError, match="squared = -1.0, expected 0 or more"):
        LossSpec(squared=-1.0)
    with pytest.raises(ValueError, match="perceptual_every = 0, expected 1"):
        LossSpec(perceptual_every=0)
    with pytest.raises(ValueError, match="perceptual weight 1.0 without"):
        LOSS(KEY, shifted, CLEAN, noise=NOISE, weights=LossSpec(perceptual=1.0))
