"""Confidence: frequencies come out, order is kept, nothing is out of 0 to 1."""

import jax
import numpy as np
import pytest

from jradar.range_image import ConfidenceTable, fit_confidence, frequency

RNG = np.random.default_rng(0)


def test_a_known_distortion_is_undone():
    truth = RNG.random(200_000)
    right = RNG.random(len(truth)) < truth
    spec = fit_confidence(np.sqrt(truth), right)  # too sure of itself
    np.testing.assert_allclose(frequency(np.sqrt(truth), spec), truth, atol=0.03)


def test_it_never_falls_and_stays_a_probability():
    confidence = RNG.random(500)
    spec = fit_confidence(confidence, RNG.random(500) < 1 - confidence)
    values = np.asarray(frequency(np.linspace(0, 1, 101), spec))
    assert (np.diff(values) >= -1e-6).all() and 0 <= values.min() <= values.max() <= 1


def test_frequencies_are_interpolated():
    spec = ConfidenceTable.of((0.0, 0.2, 1.0))
    found = frequency(np.array([0.0, 0.25, 0.5, 0.75, 1.0]), spec)
    np.testing.assert_allclose(found, [0, 0.1, 0.2, 0.6, 1.0], rtol=1e-6)
    slope = jax.grad(lambda c: frequency(c, spec))(0.75)
    np.testing.assert_allclose(slope, 1.6, rtol=1e-5)


@pytest.mark.parametrize("frequencies", [(0.5,), (0.5, 0.4), (-0.1, 0.5), (0.1, 1.1)])
def test_impossible_frequencies_are_refused(frequencies):
    with pytest.raises(ValueError, match="expected two or more that rise"):
        ConfidenceTable.of(frequencies)
    with pytest.raises(ValueError, match="least = 1.5, expected 0 to 1"):
        ConfidenceTable.of((0.0, 1.0), least=1.5)


@pytest.mark.parametrize("confidence", [[], [1.2], [np.nan]])
def test_unusable_confidences_are_refused(confidence):
    with pytest.raises(ValueError, match="expected one or more between 0 and 1"):
        fit_confidence(np.array(confidence), np.ones(len(confidence), bool))
