"""The mixture: a distribution, its likelihood, and a start from another prediction."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import logistic

from jradar.diffusion import (
    PREDICTIONS,
    NoiseSpec,
    UNet,
    conditional_denoiser,
    load_pretrained,
    mixture_loss,
    mixture_mass,
    range_mixture,
    write_params,
)
from jradar.diffusion.mixture import LEAST_SCALE, mixture_of

SHAPE = (2, 3, 4)
VALUES = np.random.default_rng(0).normal(scale=0.3, size=(*SHAPE, 14)).astype("f4")
NOISE = NoiseSpec(sigma_data=0.75, prediction=PREDICTIONS["mixture"])


def answer(x, sigma):
    """A denoiser that always returns VALUES."""
    return jnp.asarray(VALUES)


def test_the_mixture_is_a_distribution():
    mixture = mixture_of(jnp.asarray(VALUES))
    np.testing.assert_allclose(mixture.weight.sum(-1), 1, rtol=1e-5)
    assert (mixture.scale > LEAST_SCALE).all()
    far = jnp.full(SHAPE, 1e3)
    np.testing.assert_allclose(mixture_mass(mixture, -far, far), 1, rtol=1e-5)
    middle = jnp.zeros(SHAPE)
    parts = mixture_mass(mixture, -far, middle) + mixture_mass(mixture, middle, far)
    np.testing.assert_allclose(parts, 1, rtol=1e-5)


def test_mass_and_likelihood_equal_scipys():
    mixture = range_mixture(answer, (*SHAPE, 2), noise=NOISE)
    rng = np.random.default_rng(1)
    code, hit = rng.uniform(-1, 1, SHAPE), rng.random(SHAPE) < 0.5
    weight, centre, scale = (np.asarray(v, float) for v in mixture[1:])

    def expected(function, at):
        values = function(at[..., None], loc=centre, scale=scale)
        return (weight * values).sum(-1)

    mass = mixture_mass(mixture, jnp.asarray(code - 0.1), jnp.asarray(code + 0.1))
    wanted = expected(logistic.cdf, code + 0.1) - expected(logistic.cdf, code - 0.1)
    np.testing.assert_allclose(mass, wanted, atol=1e-5)

    clean = jnp.stack([jnp.asarray(code), jnp.where(jnp.asarray(hit), 1.0, -1.0)], -1)
    loss = mixture_loss(jax.random.key(0), answer, clean, noise=NOISE)
    returned = 1 / (1 + np.exp(-np.asarray(mixture.returned, float)))
    likelihood = np.where(hit, returned * expected(logistic.pdf, code), 1 - returned)
    np.testing.assert_allclose(loss, -np.log(likelihood).mean(), rtol=1e-3)


def test_the_likelihood_has_finite_gradients_far_from_all_components():
    def loss(values):
        clean = jnp.full((*SHAPE, 2), 1.0)
        return mixture_loss(
            jax.random.key(0), lambda x, sigma: values, clean, noise=NOISE
        )

    slope = jax.grad(loss)(jnp.asarray(100 * VALUES))
    assert np.isfinite(slope).all() and np.abs(slope).sum() > 0


@pytest.mark.parametrize("detail", [0, 4])
@pytest.mark.parametrize("before", ["clean", "gaussian"])
def test_weights_of_another_prediction_start_as_the_same_image(
    tmp_path, before, detail
):
    def network(prediction):
        outputs = 2 * PREDICTIONS[prediction].outputs_per_channel
        fields = {"channels": 8, "multipliers": (1,), "blocks": 1}
        return UNet(
            outputs=outputs, attention_levels=(), detail_channels=detail, **fields
        )

    rng = np.random.default_rng(2)
    condition = jnp.asarray(rng.normal(size=(1, 8, 8, 3)), jnp.float32)

    def init(net):
        image = jnp.zeros((1, 8, 32, 2))
        shapes = jax.eval_shape(
            net.init, jax.random.key(0), image, jnp.zeros(1), condition
        )
        return jax.tree.map(lambda v: jnp.asarray(rng.normal(size=v.shape) / 9), shapes)

    old, new = network(before), network("mixture")
    params = init(old)
    write_params(tmp_path / "old.safetensors", params, dtype=np.float32)
    started, report = load_pretrained(tmp_path / "old.safetensors", new, init(new))
    assert not report.new and not report.unused

    def image(net, params, prediction):
        noise = NoiseSpec(sigma_data=0.75, prediction=PREDICTIONS[prediction])
        denoise = conditional_denoiser(net, params, noise)(condition)
        return denoise(jnp.zeros((1, 8, 32, 2)), jnp.asarray(noise.sigma_max))

    found = image(new, started, "mixture")
    expected = image(old, params, before)
    np.testing.assert_allclose(found[..., :2], expected, atol=1e-3)
    np.testing.assert_array_equal(found[..., 2:], 0)


@pytest.mark.parametrize(
    "fields", [{}, {"detail_channels": 0}, {"condition_at_input": True}]
)
def test_the_shape_of_an_image_stands_for_zeros(fields):
    network = UNet(
        channels=8,
        multipliers=(1,),
        blocks=1,
        attention_levels=(),
        outputs=14,
        **fields,
    )
    rng = np.random.default_rng(0)
    condition = jnp.asarray(rng.normal(size=(1, 8, 8, 3)), jnp.float32)
    level, zeros = jnp.ones(1), jnp.zeros((1, 8, 32, 2))
    params = network.init(jax.random.key(0), zeros, level, condition)
    params = jax.tree.map(
        lambda p: jnp.asarray(rng.normal(size=p.shape), p.dtype), params
    )

    def output(x):
        features = network.apply(params, condition, method="encode")
        return network.apply(params, x, level, features, method="decode")

    shape = jax.ShapeDtypeStruct(zeros.shape, zeros.dtype)
    np.testing.assert_allclose(output(shape), output(zeros), rtol=1e-5, atol=1e-5)
    assert np.ptp(output(shape)) > 0
