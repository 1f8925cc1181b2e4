"""The answer of one pass: the likeliest window, and its probability."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.diffusion import (
    PREDICTIONS,
    NoiseSpec,
    RangeMixture,
    UNet,
    mixture_mass,
)
from jradar.model import draw, enhance
from jradar.model.methods import likeliest_range
from jradar.radar import Scatterers, simulate_cube
from jradar.range_image import CalibrationSpec, ImageSpec, calibrated, encode_range
from tests.models import SPEC, tiny_model

MARGINAL = tiny_model(
    method="marginal",
    network=UNet(
        channels=8, multipliers=(1,), blocks=1, attention_levels=(), outputs=14
    ),
    noise=NoiseSpec(sigma_data=0.7, prediction=PREDICTIONS["mixture"]),
    least_confidence=0.0,
)
SOME = jnp.zeros((8, 8, 12)).at[3, 4, 5].set(1.0)
LIKELIEST = jax.jit(likeliest_range, static_argnums=1)


def mixtures(count):
    """Random mixtures of `count` pixels."""
    rng = np.random.default_rng(0)
    return RangeMixture(
        jnp.asarray(rng.normal(size=(1, count)), jnp.float32),
        jnp.asarray(rng.dirichlet(np.ones(4), (1, count)), jnp.float32),
        jnp.asarray(rng.uniform(-0.6, 0.9, (1, count, 4)), jnp.float32),
        jnp.asarray(np.exp(rng.uniform(-5, -1.5, (1, count, 4))), jnp.float32),
    )


def test_the_window_holds_nearly_as_much_as_the_best_of_all():
    mixture = mixtures(400)
    view = {"max_range_m": SPEC.fine.max_range_m, "codec": SPEC.codec}

    @jax.jit
    @jax.vmap
    def mass(range_m):
        edges = (encode_range(range_m + side, **view) for side in (-0.2, 0.2))
        return mixture_mass(mixture, *edges)

    image = LIKELIEST(mixture, SPEC)
    grid = np.linspace(0.01, 12, 1200, dtype=np.float32)
    tried = np.broadcast_to(grid[:, None, None], (1200, 1, 400))
    found, *others = np.asarray(mass(np.concatenate([image.range_m[None], tried])))
    returned = 1 / (1 + np.exp(-np.asarray(mixture.returned)))
    np.testing.assert_allclose(image.confidence, returned * found, rtol=1e-4)
    share = found / np.max(others, axis=0)
    assert share.min() > 0.6 and share.mean() > 0.98


def test_no_point_lies_between_two_surfaces():
    near, far = encode_range(jnp.array([3.0, 6.0]), max_range_m=12.0, codec="log")
    mixture = RangeMixture(
        np.full((1, 2), 9.0, np.float32),
        np.array([[[0.6, 0.4, 0.0, 0.0], [0.4, 0.6, 0.0, 0.0]]], np.float32),
        np.tile(np.array([near, far, near, far]), (1, 2, 1)),
        np.full((1, 2, 4), 0.003, np.float32),
    )
    log = tiny_model(codec="log").spec
    image = LIKELIEST(mixture, log)
    np.testing.assert_allclose(image.range_m, [[3.0, 6.0]], atol=0.11)
    assert (abs(image.confidence - 0.6) < 0.05).all()


def test_a_model_of_one_pass_needs_no_randomness_and_takes_no_sampling_options():
    one, other = (draw(jax.random.key(seed), SOME, MARGINAL) for seed in (0, 1))
    np.testing.assert_array_equal(one.range_m, other.range_m)
    with pytest.raises(ValueError, match="draws, steps: a model of one pass draws no"):
        draw(jax.random.key(0), SOME, MARGINAL, draws=2, steps=3)


def test_confidence_is_calibrated_and_cuts_the_image():
    key = jax.random.key(0)
    raw = draw(key, SOME, MARGINAL)
    spec = CalibrationSpec((0.0, 0.1, 1.0))
    model = tiny_model(**{**vars(MARGINAL.spec), "calibration": spec})
    found = draw(key, SOME, model)
    np.testing.assert_allclose(
        found.confidence, calibrated(raw.confidence, spec), rtol=1e-6
    )
    least = float(np.median(found.confidence))
    kept = draw(key, SOME, model, least_confidence=least)
    sure = np.asarray(found.confidence) >= least
    np.testing.assert_array_equal(kept.range_m > 0, sure & (found.range_m > 0))


def test_the_cloud_carries_confidence_and_velocity():
    targets = Scatterers(
        jnp.array([[3.0, 0.5, 0.1], [4.0, -1.0, 0.0]]), jnp.zeros(2), jnp.full(2, 50.0)
    )
    cube = simulate_cube(jax.random.key(0), targets, SPEC.radar, noise_power=1.0)
    cloud = jax.tree.map(np.asarray, enhance(jax.random.key(1), cube, MARGINAL))
    valid = cloud.valid
    assert valid.any() and cloud.confidence is not None
    confidence = cloud.confidence[valid]
    assert 0 <= confidence.min() and confidence.max() <= 1
    assert cloud.velocity is not None and cloud.velocity.shape == valid.shape
    known = ~np.isnan(cloud.velocity)
    assert known.any() and not known[~valid].any()
    assert ImageSpec(8, 32).shape == SPEC.fine.shape
