"""Trust: what a Gaussian says of its own frames, and of others."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.range_image import CHANNELS, fit_trust, unlikeness
from jradar.range_image.trust import TrustTable, condition_features

SLICES = 4


def conditions(count, *, share=0.2, seed=0):
    """Random conditions with `share` of their pixels occupied, at random powers."""
    random = np.random.default_rng(seed)
    present = random.random((count, 16, 16, SLICES)) < share
    power = np.where(present, random.uniform(0.2, 0.9, present.shape), 0.0)
    parts = {"presence": present, "range": 0 * power, "power": power}
    return np.concatenate([parts[name] for name in CHANNELS], -1).astype(np.float32)


def strangeness(condition, trust):
    return unlikeness(condition_features(jnp.asarray(condition)), trust)


def test_features_are_shares_and_mean_powers():
    condition = np.zeros((16, 16, 3 * SLICES), np.float32)
    condition[:4, :8, 1] = 1.0  # an eighth of slice 1 is occupied
    condition[:4, :8, 2 * SLICES + 1] = 0.3
    features = condition_features(jnp.asarray(condition))
    expected = np.zeros(2 * SLICES)
    expected[1], expected[SLICES + 1] = 0.125**0.5, 0.3
    np.testing.assert_allclose(features, expected, atol=1e-6)


def test_one_percent_of_frames_like_training_lie_beyond_its_99th_percentile():
    trust = fit_trust(np.asarray(condition_features(conditions(2000))))
    like = np.asarray(strangeness(conditions(2000, seed=1), trust))
    assert (like > 0.99).mean() == pytest.approx(0.01, abs=0.008)
    shares = [0.25, 0.5, 0.75]
    np.testing.assert_allclose(np.quantile(like, shares), shares, atol=0.05)


def test_distances_are_those_of_frames_that_were_not_fitted():
    """Twenty frames fit a Gaussian of eight features closely: others lie farther."""
    rng = np.random.default_rng(0)
    samples = rng.normal(size=(20, 40, 8))
    farther = [np.quantile(fit_trust(each).distances, 0.5) for each in samples]
    assert np.mean(farther) > 1.1 * 8**0.5


def test_other_occupancy_is_strange():
    trust = fit_trust(np.asarray(condition_features(jnp.asarray(conditions(400)))))
    strange = strangeness(conditions(20, share=0.4, seed=3), trust)
    assert float(strange.min()) > 0.99
    empty = strangeness(jnp.zeros((16, 16, 3 * SLICES)), trust)
    assert float(empty) == 1.0
    some = jnp.asarray(conditions(3, seed=4))
    each = jax.vmap(lambda condition: strangeness(condition, trust))(some)
    np.testing.assert_allclose(each, strangeness(some, trust), atol=1e-6)


def test_too_few_frames_and_a_torn_matrix_are_refused():
    with pytest.raises(ValueError, match="3 frames, expected 40"):
        fit_trust(np.zeros((3, 8)))
    with pytest.raises(ValueError, match=r"whitening has shape \(1, 2\)"):
        TrustTable.of((0.0, 0.0), ((1.0, 0.0),), (0.0, 1.0))
