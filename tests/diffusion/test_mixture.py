"""The mixture: a distribution, its likelihood, and a start from another prediction."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import softmax
from scipy.stats import logistic

from jradar.diffusion import (
    PREDICTIONS,
    NoiseSpec,
    conditional_denoiser,
    load_pretrained,
    mixture_loss,
    range_mixture,
    window_mass,
    write_params,
)
from jradar.diffusion.mixture import mixture_of
from tests.diffusion.networks import build

SHAPE = (2, 3, 4)
VALUES = np.random.default_rng(0).normal(scale=0.3, size=(*SHAPE, 14)).astype("f4")
NOISE = NoiseSpec(sigma_data=0.75, prediction=PREDICTIONS["mixture"])
SMALL = {"multipliers": (1,), "attention_levels": ()}


def answer(x, sigma):
    """A denoiser that always returns VALUES."""
    return jnp.asarray(VALUES)


def test_outputs_are_centre_return_offsets_scales_and_weights():
    found = mixture_of(jnp.asarray(VALUES))
    centre, returned = VALUES[..., :1], VALUES[..., 1]
    offset, growth, weight = np.split(VALUES[..., 2:], 3, -1)
    np.testing.assert_allclose(found.returned, 4 * returned, rtol=1e-5)
    np.testing.assert_allclose(found.weight, softmax(4 * weight, -1), rtol=1e-5)
    np.testing.assert_allclose(found.centre, centre + offset, atol=1e-6)
    scale = np.array([0.01, 0.02, 0.05, 0.2]) * np.exp(4 * np.tanh(growth)) + 1e-3
    np.testing.assert_allclose(found.scale, scale, rtol=1e-4)


def test_mass_and_likelihood_equal_scipys():
    mixture = range_mixture(answer, (*SHAPE, 2), noise=NOISE)
    rng = np.random.default_rng(1)
    code, hit = rng.uniform(-1, 1, SHAPE), rng.random(SHAPE) < 0.5
    weight, centre, scale = (np.asarray(v, float) for v in mixture[1:])

    def expected(function, at):
        values = function(at[..., None], loc=centre, scale=scale)
        return (weight * values).sum(-1)

    mass = window_mass(mixture)(jnp.asarray(code - 0.1), jnp.asarray(code + 0.1))
    wanted = expected(logistic.cdf, code + 0.1) - expected(logistic.cdf, code - 0.1)
    np.testing.assert_allclose(mass, wanted, atol=1e-5)

    clean = jnp.asarray(np.stack([code, np.where(hit, 1.0, -1.0)], -1), jnp.float32)
    loss = mixture_loss(jax.random.key(0), answer, clean, noise=NOISE)
    returned = 1 / (1 + np.exp(-np.asarray(mixture.returned, float)))
    likelihood = np.where(hit, returned * expected(logistic.pdf, code), 1 - returned)
    np.testing.assert_allclose(loss, -np.log(likelihood).mean(), rtol=1e-3)


def test_one_of_four_pixels_counts_at_the_same_place_in_all():
    rng = np.random.default_rng(2)
    shape = (2, 6, 8)
    values = jnp.asarray(rng.normal(scale=0.3, size=(*shape, 14)), jnp.float32)
    clean = jnp.asarray(rng.uniform(-1, 1, (*shape, 2)), jnp.float32)

    def loss_of(key, values, clean):
        return float(mixture_loss(key, lambda x, sigma: values, clean, noise=NOISE))

    found = {round(loss_of(jax.random.key(i), values, clean), 5) for i in range(40)}
    places = [(slice(i, None, 2), slice(j, None, 2)) for i in (0, 1) for j in (0, 1)]
    expected = [
        loss_of(jax.random.key(0), values[:, *p], clean[:, *p]) for p in places
    ]  # of 3 x 4 pixels, an odd number: all count
    assert sorted(found) == pytest.approx(sorted(expected), abs=2e-5)


def test_where_a_scan_observed_nothing_the_likelihood_is_that_of_the_rest():
    clean = np.stack([np.full(SHAPE, 0.3), np.ones(SHAPE)], -1)
    clean[:, 1:, :, 1] = 0.0

    def loss_of(values, clean):
        def denoise(x, sigma):
            return jnp.asarray(values)

        return float(mixture_loss(jax.random.key(0), denoise, clean, noise=NOISE))

    some = loss_of(VALUES[:, :1], jnp.asarray(clean[:, :1]))
    assert loss_of(VALUES, jnp.asarray(clean)) == pytest.approx(some, rel=1e-5)


def test_the_likelihood_has_finite_gradients_far_from_all_components():
    @jax.jit
    @jax.grad
    def slope(values):
        clean = jnp.full((*SHAPE, 2), 1.0)
        key = jax.random.key(0)
        return mixture_loss(key, lambda x, sigma: values, clean, noise=NOISE)

    found = np.asarray(slope(100 * VALUES))
    assert np.isfinite(found).all() and np.abs(found).sum() > 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("before", "detail"), [("clean", 0), ("gaussian", 0), ("gaussian", 4)]
)
def test_weights_of_another_prediction_start_as_that_image(tmp_path, before, detail):
    (old, params, (*_, condition)), (new, other, _) = (
        build(
            outputs=2 * PREDICTIONS[kind].outputs_per_channel,
            detail_channels=detail,
            **SMALL,
        )
        for kind in (before, "mixture")
    )
    params = jax.tree.map(lambda leaf: leaf / 3, params)  # spreads like the data's
    write_params(tmp_path / "old.safetensors", params, dtype=np.float32)
    started, report = load_pretrained(tmp_path / "old.safetensors", new, other)
    assert not report.new and not report.unused

    def image(net, params, prediction):
        noise = NoiseSpec(sigma_data=0.75, prediction=PREDICTIONS[prediction])

        @jax.jit
        def denoised(params):
            denoise = conditional_denoiser(net, params, noise)(condition)
            return denoise(jnp.zeros((2, 8, 32, 2)), jnp.asarray(noise.sigma_max))

        return denoised(params)

    found = np.asarray(image(new, started, "mixture"))
    expected = image(old, params, before)
    np.testing.assert_allclose(found[..., :2], expected, atol=1e-3)
    np.testing.assert_array_equal(found[..., 2:], 0)


@pytest.mark.slow
@pytest.mark.parametrize(
    "fields", [{}, {"detail_channels": 0}, {"condition_at_input": True}]
)
def test_the_shape_of_an_image_stands_for_zeros(fields):
    network, params, (x, level, condition) = build(outputs=14, **SMALL, **fields)
    shape = jax.ShapeDtypeStruct(x.shape, x.dtype)

    @jax.jit
    def outputs(params):
        features = network.apply(params, condition, method="encode")
        both = (shape, jnp.zeros_like(x))
        decode = {"method": "decode"}
        return [network.apply(params, one, level, features, **decode) for one in both]

    blank, zeros = outputs(params)
    np.testing.assert_allclose(blank, zeros, rtol=1e-5, atol=1e-5)
    assert np.ptp(blank) > 0
