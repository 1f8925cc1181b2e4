"""The answer of one pass: the likeliest window, and its probability."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.diffusion import RangeMixture, window_mass
from jradar.model import dense_cloud, draw, enhance
from jradar.model.grids.view.answers import likeliest_range
from jradar.radar import Radar
from jradar.range_image import (
    ConfidenceTable,
    encode_range,
    frequency,
    image_cloud,
    near_echo,
)
from jradar.types import PointCloud
from tests.models import CONDITION_SHAPE, GRID, RADAR, SPEC, echoes, one_pass_model

MARGINAL = one_pass_model()
KEY = jax.random.key(0)
SOME = jnp.zeros(CONDITION_SHAPE).at[3, 4, 5].set(1.0)


def mixtures(count):
    """Random mixtures of `count` pixels."""
    rng = np.random.default_rng(0)
    parts = (
        rng.normal(size=(1, count)),
        rng.dirichlet(np.ones(4), (1, count)),
        rng.uniform(-0.6, 0.9, (1, count, 4)),
        np.exp(rng.uniform(-5, -1.5, (1, count, 4))),
    )
    return RangeMixture(*(jnp.asarray(part, jnp.float32) for part in parts))


def test_the_window_holds_nearly_as_much_as_the_best_of_all():
    mixture = mixtures(400)
    view = {"max_range_m": SPEC.grid.fine.max_range_m, "codec": SPEC.grid.codec}

    @jax.jit
    def mass(range_m):
        edges = (encode_range(range_m + side, **view) for side in (-0.2, 0.2))
        return window_mass(mixture)(*edges)

    image = likeliest_range(mixture, GRID)
    found = np.asarray(mass(image.range_m))
    returned = 1 / (1 + np.exp(-np.asarray(mixture.returned)))
    np.testing.assert_allclose(image.confidence, returned * found, rtol=1e-4)
    grid = np.linspace(0.01, 12, 1200, dtype="float32")
    best = np.max([mass(np.full((1, 400), r, "float32")) for r in grid], axis=0)
    share = found / best
    assert share.min() > 0.6 and share.mean() > 0.98


def test_no_point_lies_between_two_surfaces():
    near, far = encode_range(jnp.array([3.0, 6.0]), max_range_m=12.0, codec="log")
    shape = (1, 2)
    mixture = RangeMixture(
        jnp.full(shape, 9.0),
        jnp.asarray([[[0.6, 0.4, 0.0, 0.0], [0.4, 0.6, 0.0, 0.0]]]),
        jnp.broadcast_to(jnp.stack([near, far, near, far]), (*shape, 4)),
        jnp.full((*shape, 4), 0.003),
    )
    image = likeliest_range(mixture, dataclasses.replace(GRID, codec="log"))
    np.testing.assert_allclose(image.range_m, [[3.0, 6.0]], atol=0.11)
    np.testing.assert_allclose(image.confidence, 0.6, atol=0.05)


def test_a_model_of_one_pass_needs_no_randomness_and_takes_no_sampling_options():
    one, other = (draw(jax.random.key(seed), SOME, MARGINAL) for seed in (0, 1))
    np.testing.assert_array_equal(one.range_m, other.range_m)
    with pytest.raises(ValueError, match="draws, steps: a model of one pass draws no"):
        draw(KEY, SOME, MARGINAL, draws=2, steps=3)


def test_confidence_is_calibrated_and_cuts_the_image():
    raw = draw(KEY, SOME, MARGINAL)
    table = ConfidenceTable.of((0.0, 0.1, 1.0), least=0.0)
    model = MARGINAL.with_tables(confidence=table)
    found = draw(KEY, SOME, model)
    expected = frequency(raw.confidence, table)
    np.testing.assert_allclose(found.confidence, expected, rtol=1e-6)
    least = float(np.median(found.confidence))
    kept = draw(KEY, SOME, model, least_confidence=least)
    sure = np.asarray(found.confidence) >= least
    np.testing.assert_array_equal(kept.range_m > 0, sure & (found.range_m > 0))


def test_what_is_alone_must_be_surer():
    image = draw(KEY, SOME, MARGINAL)
    hit = np.asarray(image.range_m).ravel() > 0
    alone = float(np.median(image.confidence))
    table = MARGINAL.tables.confidence._replace(least_alone=np.float32(alone))
    model = MARGINAL.with_tables(confidence=table)
    xyz = np.asarray(image_cloud(image, SPEC.grid.fine).xyz)
    points = PointCloud(jnp.asarray(xyz[hit][:3]), jnp.ones(3, bool))
    near = np.asarray(near_echo(image_cloud(image, GRID.fine), points, GRID.fine))
    sure = np.asarray(image.confidence).ravel() >= alone
    valid = np.asarray(dense_cloud(image, points, model).valid)
    np.testing.assert_array_equal(valid, hit & (near | sure))
    assert (hit & near).any() and (hit & ~valid).any()
    asked = dense_cloud(image, points, model, least_confidence=0.0)
    np.testing.assert_array_equal(asked.valid, hit)


def test_the_radars_own_points_are_kept_with_a_confidence_of_their_own():
    image = draw(KEY, SOME, MARGINAL)
    random = np.random.default_rng(0)
    xyz = np.concatenate([random.normal([3, 0, 0], 0.1, (30, 3)), [[6.0, 1.0, 0.5]]])
    points = PointCloud.from_xyz(xyz)._replace(velocity=jnp.arange(31.0))
    pixels = dense_cloud(image, points, MARGINAL)
    assert pixels.valid.shape == (np.prod(SPEC.grid.fine.shape),)
    table = ConfidenceTable.of((0.0, 1.0), least=0.3)
    model = MARGINAL.with_tables(echoes=table)
    found = dense_cloud(image, points, model)
    jax.tree.map(
        lambda part, whole: np.testing.assert_array_equal(part, whole[: len(part)]),
        pixels,
        found,
    )
    added = jax.tree.map(lambda values: values[len(pixels.valid) :], found)
    valid = np.asarray(added.valid)
    assert valid.sum() == 300 and not valid[300:].any()  # the last is alone
    expected = np.log(30) / np.log(1024)
    np.testing.assert_allclose(np.asarray(added.confidence)[valid], expected, rtol=1e-5)
    np.testing.assert_array_equal(np.asarray(added.velocity)[:300:10], np.arange(30.0))
    for options, count in (
        ({"least_confidence": 0.6}, 0),
        ({"least_confidence": 0.0}, 310),
        ({"fused": True}, 300),
    ):
        asked = dense_cloud(image, points, model, **options)
        assert np.asarray(asked.valid)[len(pixels.valid) :].sum() == count
    sampled = dense_cloud(image._replace(confidence=None), points, model)
    assert sampled.confidence is None
    np.testing.assert_array_equal(sampled.valid[len(pixels.valid) :], added.valid)


def test_the_cloud_carries_confidence_and_velocity():
    cloud = enhance(KEY, echoes(), Radar(RADAR), MARGINAL)
    valid = np.asarray(cloud.valid)
    assert valid.any() and cloud.confidence is not None
    confidence = np.asarray(cloud.confidence)[valid]
    assert 0 <= confidence.min() and confidence.max() <= 1
    assert cloud.velocity is not None and cloud.velocity.shape == valid.shape
    known = ~np.isnan(np.asarray(cloud.velocity))
    assert known.any() and not known[~valid].any()
