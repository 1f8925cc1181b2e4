"""Confidence: it holds on frames of known truth, with its three thresholds."""

import numpy as np
import pytest

from jradar.evaluation.confidence import (
    THRESHOLDS,
    Judged,
    fitted,
    fitted_table,
    least_alone,
    least_confidence,
    mean_f_scores,
)
from jradar.metrics import f_score, near_truth
from jradar.model.grids.polar import LIDAR
from jradar.model.mirror import scaled
from jradar.range_image import frequency
from jradar.types import PointCloud
from tests.models import tiny_model, tiny_polar_model

MODEL = tiny_polar_model()
GRID = MODEL.spec.frame_grid
WALL = np.stack([np.full(200, 6.0), np.linspace(-4, 4, 200), np.zeros(200)], -1)
NOTHING = np.zeros((0, 3)), np.zeros(0), np.zeros(0, bool)


def on_a_line(wrong_from):
    """Points on a line, of which those above a confidence are right."""
    truth = np.stack([np.arange(0.0, 100.0, 0.5)] + [np.zeros(200)] * 2, -1)
    confidence = np.linspace(0, 1, 200)
    away = np.where(confidence < wrong_from, 30.0, 0.0)
    xyz = truth + np.stack([0 * away, away, 0 * away], -1)
    return Judged(xyz, confidence, away == 0, truth)


def answers(rng, share, disagreement=None):
    """Answers whose pixels are right as often as `share` of their value."""
    xyz = LIDAR.xyz[100:160].reshape(-1, 3)
    for _ in range(6):
        value = rng.uniform(0.05, 0.95, len(xyz))
        right = rng.random(len(xyz)) < share * value
        yield Judged(xyz, value, right, xyz[right], disagreement=disagreement)


def test_wrong_points_are_cut_off_and_right_ones_kept():
    assert 0.3 <= least_confidence([on_a_line(0.32)]) <= 0.35
    assert least_confidence([on_a_line(0.0)]) == 0.05
    between = least_confidence([on_a_line(0.2), on_a_line(0.5)])
    assert 0.2 <= between <= 0.5
    # Each group counts alike, however many frames it has.
    many, one = [on_a_line(0.5)] * 9, on_a_line(0.0)
    assert least_confidence([*many, one]) > 0.4
    assert least_confidence(many, [one]) == 0.05


def test_scores_above_each_threshold_are_f_scores_of_the_points_kept():
    random = np.random.default_rng(3)
    truth, xyz = random.normal(size=(200, 3)), random.normal(size=(300, 3))
    found = Judged(xyz, random.random(300), near_truth(xyz, truth), truth)
    scores = mean_f_scores([found])
    for least, score in zip(THRESHOLDS, scores, strict=True):
        expected = f_score(xyz[found.confidence >= least], truth)
        assert score == pytest.approx(expected) and score > 0
    nothing = found._replace(confidence=np.zeros(300))
    assert (mean_f_scores([nothing]) == 0).all()


@pytest.mark.parametrize("model", [MODEL, tiny_model()], ids=["polar", "view"])
def test_groups_count_alike_in_the_table_of_any_grid(model):
    rng = np.random.default_rng(0)
    (often, *_), seldom = answers(rng, 0.9), [*answers(rng, 0.5)]
    tables = fitted(model, [[often], [], seldom]).tables
    assert tables.scaling is None and tables.echoes is None
    found = frequency(np.array([0.3, 0.6, 0.9]), tables.confidence)
    np.testing.assert_allclose(found, 0.7 * np.array([0.3, 0.6, 0.9]), atol=0.03)
    assert 0 < tables.confidence.least < 0.75 and tables.confidence.least_alone == 0


def test_confidence_holds_at_every_disagreement():
    rng = np.random.default_rng(0)
    shares = {0.1: 0.95, 0.2: 0.8, 0.3: 0.6}
    groups = [[*answers(rng, share, apart)] for apart, share in shares.items()]
    tables = fitted(MODEL, [*groups, []]).tables
    assert tables.scaling is not None
    for apart, share in shares.items():
        (answer, *_) = answers(rng, share)
        often = frequency(answer.confidence, tables.confidence)
        said, right = scaled(often, apart, tables.scaling), answer.right
        assert abs(said.mean() - right.mean()) < 0.03
        sure = answer.confidence > 0.7
        assert abs(said[sure].mean() - right[sure].mean()) < 0.05


def test_the_radars_points_are_as_sure_as_they_are_right_where_they_gather():
    rng = np.random.default_rng(1)

    def heard():
        alone = rng.uniform((1, -4, 0), (5, 4, 0), (30, 3))
        points = np.concatenate([WALL + rng.normal(0, 0.05, WALL.shape), alone])
        wrong = np.array([[2.0, 0, 0]]), np.array([0.05]), np.array([False])
        return Judged(*wrong, WALL, PointCloud.from_xyz(points))

    groups = [[*answers(rng, 0.9)], [heard() for _ in range(6)]]
    assert fitted(MODEL, groups[:1]).tables.echoes is None
    tables = fitted(MODEL, groups).tables
    assert tables.echoes is not None
    lone, gathered = frequency(np.array([0, 0.5]), tables.echoes)
    assert lone < 0.2 and gathered > 0.8
    assert lone < tables.echoes.least * gathered < gathered


def test_points_alone_need_as_much_as_costs_no_score():
    rng = np.random.default_rng(4)
    hears = PointCloud.from_xyz(WALL)
    near = np.arange(800) < 400

    def frame(wrong):
        xyz = np.where(near[:, None], np.repeat(WALL, 4, axis=0), (2.0, 0, 0))
        xyz = xyz + rng.normal(0, 0.15, xyz.shape) * (1, 1, 0)
        truth = np.concatenate([WALL, xyz[400:] + (0, 0, wrong)])
        return Judged(xyz, rng.random(800), near_truth(xyz, truth), truth, hears)

    for wrong in (0.0, 0.18, 1.0):
        drawn = frame(wrong)
        around = drawn._replace(xyz=WALL, confidence=np.ones(200))
        around = around._replace(right=np.ones(200, bool))
        beside = near | near_truth(drawn.xyz, WALL)  # within half a metre
        joined = drawn._replace(confidence=np.where(beside, 1, drawn.confidence))
        scores = mean_f_scores([joined.joined(around)])
        expected = THRESHOLDS[np.flatnonzero(scores >= scores[0])[-1]]
        assert least_alone([[drawn]], [[around]], GRID) == expected
        assert wrong < 1 or expected == THRESHOLDS[-1]
        assert wrong > 0 or expected == THRESHOLDS[0]
    unknown = drawn._replace(radar=None)
    assert least_alone([[unknown]], [[around]], GRID) == 0


@pytest.mark.parametrize("groups", [(), ([],), ([Judged(*NOTHING, WALL)],)])
def test_without_a_point_the_model_stays_as_it_is(groups):
    assert fitted(MODEL, groups) is MODEL


def test_a_table_is_of_the_networks_own_values_whatever_the_model_had():
    rng = np.random.default_rng(0)
    groups = [[*answers(rng, 0.8)]]
    once = fitted(MODEL, groups)
    assert fitted(once, groups).tables.confidence.least == once.tables.confidence.least
    expected = fitted_table(groups).frequencies
    np.testing.assert_array_equal(once.tables.confidence.frequencies, expected)
