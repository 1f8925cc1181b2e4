"""Reliability of confidence: hand-made numbers, known offsets, ties, plain errors."""

import numpy as np
import pytest

from jradar.evaluation import Reliability, precision_over_coverage, reliability
from jradar.metrics import near_truth


def bins_of(*groups):
    """Points of (confidence, number, number of right ones)."""
    confidence = np.concatenate([np.full(n, value) for value, n, _ in groups])
    right = np.concatenate([np.arange(n) < good for _, n, good in groups])
    return confidence, right


def test_bins_count_and_average_the_points_between_their_edges():
    confidence = np.array([0.0, 0.05, 0.1, 0.19, 0.95, 1.0])
    right = np.array([False, True, False, True, True, True])
    found = reliability(confidence, right)
    assert found.points.tolist() == [2, 2, 0, 0, 0, 0, 0, 0, 0, 2]
    nan = [np.nan] * 7
    said, share = found.means()
    np.testing.assert_allclose(said, [0.025, 0.145, *nan, 0.975])
    np.testing.assert_allclose(share, [0.5, 0.5, *nan, 1.0])
    _, (halves,) = reliability(confidence, right, bins=1).means()
    assert halves == pytest.approx(4 / 6)


RIGHT = (0.25, 40, 10), (0.5, 10, 5), (0.75, 200, 150)


@pytest.mark.parametrize(
    ("groups", "error"),
    [
        ([*RIGHT, (1.0, 3, 3)], 0.0),
        ([(value + 0.125, *counts) for value, *counts in RIGHT], 0.125),
        ([(value - 0.25, *counts) for value, *counts in RIGHT], 0.25),
        ([(0.95, 30, 0), (0.05, 10, 0)], (30 * 0.95 + 10 * 0.05) / 40),
    ],
)
def test_the_error_is_the_offset_weighed_by_points(groups, error):
    found = reliability(*bins_of(*groups)).error()
    assert found == pytest.approx(error, abs=1e-12)
    parts = [reliability(*bins_of(group)) for group in groups]
    assert Reliability(*np.sum(parts, 0)).error() == pytest.approx(error, abs=1e-12)


def test_the_diagram_is_scikit_learns():
    peer = pytest.importorskip("sklearn.calibration")
    rng = np.random.default_rng(0)
    confidence = rng.beta(0.7, 1.3, size=4000)
    right = rng.random(4000) < confidence**1.5
    found = reliability(confidence, right)
    share, mean = peer.calibration_curve(right, confidence, n_bins=10)
    np.testing.assert_allclose(found.means(), (mean, share))


def test_precision_is_of_the_most_confident_points():
    confidence = np.array([0.1, 0.9, 0.5, 0.7])
    right = np.array([False, True, False, True])
    found = precision_over_coverage(confidence, right, parts=4)
    np.testing.assert_allclose(found.kept, [0.25, 0.5, 0.75, 1])
    np.testing.assert_allclose(found.precision, [1, 1, 2 / 3, 0.5])


def test_equal_confidences_have_the_precision_of_all_of_them():
    right = np.arange(100) < 30
    found = precision_over_coverage(np.full(100, 0.375), right)
    np.testing.assert_allclose(found.precision, 0.3)
    points = bins_of((0.875, 50, 40), (0.125, 50, 10))
    found = precision_over_coverage(*points)
    # all of the first, then 25 of the others, of which 5 are right on average
    assert found.precision[4] == pytest.approx(40 / 50)
    assert found.precision[6] == pytest.approx((40 + 4) / 70)
    assert found.precision[-1] == pytest.approx(0.5)


def test_the_order_of_points_does_not_matter():
    rng = np.random.default_rng(1)
    confidence, right = rng.integers(0, 9, 500) / 8, rng.random(500) < 0.4
    mixed = rng.permutation(500)
    for function in (reliability, precision_over_coverage):
        first, second = (
            function(confidence[at], right[at]) for at in (slice(None), mixed)
        )
        for one, other in zip(first, second, strict=True):
            np.testing.assert_allclose(one, other)


def test_a_point_is_right_up_to_the_distance():
    truth = np.array([[1.0, 0, 0], [5, 0, 0]])
    xyz = np.array([[1.25, 0, 0], [1, 0.2501, 0], [3, 0, 0], [5, 0.1, 0.1]])
    assert near_truth(xyz, truth, within_m=0.25).tolist() == [True, False, False, True]
    assert not near_truth(xyz, truth[:0]).any()
    assert near_truth(xyz[:0], truth).shape == (0,)


def test_what_cannot_be_scored_is_named():
    none, one = np.zeros(0), np.array([0.5])
    for function in (reliability, precision_over_coverage):
        with pytest.raises(ValueError, match="one point or more"):
            function(none, none.astype(bool))
        with pytest.raises(Exception, match="one of each point|Type-check"):
            function(one, np.array([True, False]))
        for bad in (-0.1, 1.5, np.nan):
            with pytest.raises(ValueError, match="expected 0 to 1"):
                function(np.array([0.5, bad]), np.array([True, False]))
