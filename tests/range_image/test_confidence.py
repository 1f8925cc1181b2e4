"""Confidence: agreement of draws equals a count by hand; frequencies come out."""

import jax
import numpy as np
import pytest

from jradar.range_image import (
    ConfidenceTable,
    RangeImage,
    agreed_range,
    confident,
    fit_confidence,
    frequency,
)

RNG = np.random.default_rng(0)


def by_hand(ranges, share, tolerance_m=0.2):
    """The same for one pixel, in plain Python."""
    hits = [r for r in ranges if r > 0]
    groups = [[s for s in hits if abs(s - r) <= tolerance_m] for r in hits]
    most = max((len(group) for group in groups), default=0)
    if most == 0 or most < share * len(ranges):
        return 0.0
    return min(np.mean(group) for group in groups if len(group) == most)


@pytest.mark.parametrize("share", [0.25, 0.375, 0.5, 1.0])
def test_it_equals_a_count_by_hand_in_any_order(share):
    rng = np.random.default_rng(0)
    surfaces = rng.choice([0.0, 2.0, 2.3, 5.0], size=(8, 6, 7))
    images = np.where(surfaces > 0, surfaces + rng.uniform(0, 0.15, (8, 6, 7)), 0)
    images = images.astype(np.float32)
    agreed = np.asarray(confident(agreed_range(images), share).range_m)
    expected = [by_hand(pixel, share) for pixel in np.float64(images.reshape(8, -1).T)]
    np.testing.assert_allclose(agreed.ravel(), expected, rtol=1e-5)
    if share < 0.5:
        assert 0 < np.count_nonzero(agreed)
    shuffled = confident(agreed_range(images[rng.permutation(8)]), share).range_m
    np.testing.assert_allclose(shuffled, agreed, rtol=1e-6)


def test_no_point_hangs_between_two_surfaces():
    images = np.full((8, 1, 3), 2.0, np.float32)
    images[:5, 0, 1] = 6.0  # five of eight behind, three in front
    images[:, 0, 2] = [0, 0, 0, 0, 0, 0, 4, 4.1]  # two are too few
    image = agreed_range(images)
    np.testing.assert_allclose(image.confidence, [[1.0, 0.625, 0.25]])
    kept = confident(image, 0.375)
    np.testing.assert_allclose(kept.range_m, [[2.0, 6.0, 0.0]], rtol=1e-6)
    np.testing.assert_allclose(kept.confidence, [[1.0, 0.625, 0.0]])
    np.testing.assert_array_equal(  # an image without confidence is kept whole
        confident(RangeImage(image.range_m), 0.9).range_m, image.range_m
    )


def test_vmap_over_frames_equals_the_loop():
    frames = np.random.default_rng(1).uniform(0, 1, (2, 4, 3, 5)).astype(np.float32)
    batch = jax.vmap(agreed_range)(frames)
    for i in range(2):
        alone = agreed_range(frames[i])
        np.testing.assert_allclose(batch.range_m[i], alone.range_m, rtol=1e-6)


def test_a_known_distortion_is_undone():
    truth = RNG.random(200_000)
    right = RNG.random(len(truth)) < truth
    spec = fit_confidence(np.sqrt(truth), right)  # too sure of itself
    np.testing.assert_allclose(frequency(np.sqrt(truth), spec), truth, atol=0.03)


def test_weights_are_repetitions():
    confidence, right = RNG.random(300), RNG.random(300) < 0.5
    often = np.where(confidence > 0.5, 3, 1)
    expected = fit_confidence(np.repeat(confidence, often), np.repeat(right, often))
    found = fit_confidence(confidence, right, weights=often.astype(float))
    np.testing.assert_allclose(found.frequencies, expected.frequencies, atol=1e-4)
    plain = fit_confidence(confidence, right)
    assert not np.allclose(plain.frequencies, expected.frequencies, atol=1e-3)


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
