"""Occupancy images: agreement of draws, and what methods draw."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.configs import radarhd, radarhd_nearness
from experiments.radarhd import model
from jradar.errors import UsageError
from jradar.model import save_model
from jradar.model.grids.polar import RADAR, agreed_occupancy
from tests.experiments.radarhd.conftest import random_model, shrink

KEY = jax.random.key(0)


def test_agreement_is_the_share_of_draws_with_a_pixel_nearby():
    draws = np.zeros((4, 6, 6), np.float32)
    draws[0, 2, 2] = draws[1, 3, 3] = draws[2, 2, 5] = 1
    expected = np.zeros((6, 6))
    expected[2, 2] = expected[3, 3] = 0.5  # one apart, in two of four draws
    expected[2, 5] = 0.25
    batch = np.stack([draws, draws[:, ::-1]], 1)
    both = np.asarray(agreed_occupancy(jnp.asarray(batch)))
    np.testing.assert_allclose(both, [expected, expected[::-1]])


def test_the_mean_with_the_mirror_image_is_a_mirror_image_itself():
    weight = np.random.default_rng(0).uniform(size=(1, 4, 6))
    condition = np.random.default_rng(1).uniform(size=(3, 4, 6, 1))

    def both(condition):
        drawn = model.nearness_answers(lambda _, c: c[..., 0] * weight, KEY, condition)
        return dict(drawn)["one pass and its mirror image"]

    found = both(condition)
    np.testing.assert_allclose(both(condition[:, :, ::-1]), found[:, :, ::-1])
    even = condition[..., 0] * (weight + weight[..., ::-1]) / 2
    np.testing.assert_allclose(found, even)


@pytest.mark.parametrize(
    ("method", "answer", "expected"),
    [
        ("diffusion", "occupancy", "occupancy"),
        ("diffusion", "diffusion", "diffusion"),
        ("regression", "occupancy", "occupancy"),
        ("nearness", "diffusion", "nearness"),
    ],
)
def test_what_a_network_learnt_decides_how_its_model_answers(method, answer, expected):
    config = radarhd.get_config()
    config.update(method=method, answer=answer)
    assert model.build_spec(config).method == expected


def test_an_answer_that_the_grid_does_not_know_is_named():
    config = radarhd.get_config()
    config.answer = "guess"
    with pytest.raises(UsageError, match="config.answer: method = 'guess', expected"):
        model.build_spec(config)


@pytest.mark.slow
def test_draws_agree_and_are_averaged_with_nearness(tmp_path, monkeypatch):
    config, other = shrink(radarhd.get_config()), shrink(radarhd_nearness.get_config())
    other.data.history = 1
    drawing, near = random_model(config), random_model(other)
    save_model(tmp_path / "near", near, dtype=np.float32)
    config.nearness = str(tmp_path / "near")
    monkeypatch.setattr(model, "QUICK_STEPS", config.sampling.steps)
    condition = jax.random.uniform(KEY, (1, *RADAR.shape, 1))
    found = dict(model.answers(config, drawing)(KEY, condition))
    fixed = {"params": drawing.params, "noise": drawing.spec.noise, "steps": 2}
    fixed["network"] = drawing.spec.network
    first, second = jax.random.split(KEY)
    straight = model.draw_images(first, condition, **fixed)
    flipped = model.draw_images(second, condition[:, :, ::-1], **fixed)[..., ::-1]
    agreed = agreed_occupancy(jnp.stack([straight, flipped]))
    np.testing.assert_array_equal(found["2 draws"], agreed)
    *_, (_, mirrored) = model.answers(other, near)(KEY, condition)
    mean = (agreed + mirrored) / 2
    np.testing.assert_allclose(found["2 draws and nearness"], mean, atol=1e-6)
    names = ["one-step estimate", "one pass from zero", "diffusion, iPNDM 2"]
    assert [*found] == [*names, "2 draws", "2 draws and nearness"]
    config.data.history = 2
    with pytest.raises(UsageError, match="sees PolarGrid.history=1., .*history=2"):
        model.answers(config, random_model(config))
