"""Confidence by the agreement of two answers: closed forms, a fit of known truth."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import expit, logit

from jradar.model.mirror import (
    Pixels,
    Scaling,
    disagreement,
    expected_f_score,
    fit_scaling,
    least_confidence,
    scaled,
)


def test_disagreement_is_0_of_the_same_images_and_1_of_separate_ones():
    one = jnp.zeros((4, 6)).at[:2].set(0.7)
    other = jnp.zeros((4, 6)).at[2:].set(0.2)
    assert float(disagreement(one, one)) == 0
    assert float(disagreement(one, other)) == pytest.approx(1)
    assert float(disagreement(one, one / 2)) == pytest.approx(1 / 3)
    none = jnp.zeros((4, 6))
    assert float(disagreement(none, none)) == 0
    both = disagreement(jnp.stack([one, one]), jnp.stack([one, other]))
    np.testing.assert_allclose(both, [0, 1], atol=1e-6)


def test_confidence_follows_its_closed_form_and_falls_with_disagreement():
    said = jnp.array([0.0, 0.2, 0.6, 0.99])
    unscaled = Scaling.of((0, 0), (1, 0))
    np.testing.assert_allclose(scaled(said, 0.4, unscaled), said, atol=1e-6)
    scaling = Scaling.of((0.2, -2.0), (1.0, -1.1))
    found = [np.asarray(scaled(said, d, scaling)) for d in (0.1, 0.3)]
    expected = expit(0.2 - 2.0 * 0.3 + (1.0 - 1.1 * 0.3) * logit(said[1:]))
    np.testing.assert_allclose(found[1][1:], expected, atol=1e-5)
    assert found[0][0] == found[1][0] == 0
    assert (found[1][2:] < found[0][2:]).all()
    beyond = np.asarray(scaled(said, 1.0, scaling))  # a scale of -0.1 counts as 0
    np.testing.assert_allclose(beyond[1:], expit(-1.8), atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_the_expected_f_score_is_that_of_the_best_set(seed):
    said = np.random.default_rng(seed).beta(0.3, 1.0, (40, 50)).astype(np.float32)
    sure = np.sort(said[said >= 0.05])[::-1]
    best = (2 * np.cumsum(sure) / (np.arange(len(sure)) + 1 + sure.sum())).max()
    image = jnp.asarray(said)
    assert float(expected_f_score(image)) == pytest.approx(best, abs=0.002)
    assert float(least_confidence(image, 0.6)) == pytest.approx(0.6 * best, abs=0.002)
    # The best set ends at half of it.
    (last,) = np.flatnonzero(np.diff(sure >= best / 2))
    ends = 2 * sure[: last + 1].sum() / (last + 1 + sure.sum())
    assert ends == pytest.approx(best, abs=0.002)


def test_no_pixel_that_counts_as_empty_is_kept():
    none = jnp.full((4, 4), 0.04)
    assert float(expected_f_score(none)) == 0
    assert float(least_confidence(none, 0.6)) == pytest.approx(0.05)
    certain = none.at[0].set(1.0)
    assert float(expected_f_score(certain)) == 1


def test_a_fit_finds_the_scaling_that_the_truth_was_drawn_from():
    rng, true = np.random.default_rng(0), Scaling.of((0.3, -2.0), (1.1, -1.0))
    images = []
    for apart in np.linspace(0.05, 0.4, 12).tolist():
        said = rng.uniform(0.02, 0.98, 40_000)
        true_share = np.asarray(scaled(jnp.asarray(said), apart, true))
        right = rng.random(len(said)) < true_share
        images.append(Pixels(said, right, apart))
    images.append(Pixels(np.zeros(0), np.zeros(0, bool), 0.9))
    found = fit_scaling(images)
    np.testing.assert_allclose(found.offset, true.offset, atol=0.15)
    np.testing.assert_allclose(found.scale, true.scale, atol=0.15)
    for image in images[:-1]:
        said = scaled(jnp.asarray(image.frequency), image.disagreement, found)
        assert abs(float(said.mean()) - image.right.mean()) < 0.01


def test_wrong_values_are_named():
    with pytest.raises(ValueError, match=r"offset = .*expected two finite numbers"):
        Scaling.of((0.0, np.nan), (1.0, 0.0))
    with pytest.raises(ValueError, match=r"scale = .*expected two finite numbers"):
        Scaling.of((0.0, 0.0), (1.0,))
    with pytest.raises(ValueError, match="no pixels, expected one or more images"):
        fit_scaling([Pixels(np.zeros(0), np.zeros(0, bool), 0.1)])
