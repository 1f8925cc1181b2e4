"""The confidence of planar models holds where two answers agree and where not."""

import dataclasses

import numpy as np
import pytest

from experiments.radarhd.describe import (
    Answer,
    around,
    confidence,
    with_echoes,
    with_scaled_confidence,
)
from jradar.evaluation import THRESHOLDS, Judged
from jradar.model.grids.polar import LIDAR
from tests.models import tiny_polar_model

MODEL = tiny_polar_model()


def answers(rng, disagreement, share):
    """Answers whose pixels are right as often as `share` of their value."""
    xyz = LIDAR.xyz[100:160].reshape(-1, 3)
    for _ in range(6):
        value = rng.uniform(0.05, 0.95, len(xyz))
        right = rng.random(len(xyz)) < share * value
        yield Answer(138, Judged(xyz, value, right, xyz[right]), disagreement)


def test_confidence_holds_at_every_disagreement():
    rng = np.random.default_rng(0)
    shares = {0.1: 0.95, 0.2: 0.8, 0.3: 0.6}
    groups = [[*answers(rng, *each)] for each in shares.items()]
    model = with_scaled_confidence(MODEL, [*groups, []])
    for apart, share in shares.items():
        (answer, *_) = answers(rng, apart, share)
        said, right = confidence(answer, model), answer.pixels.right
        assert abs(said.mean() - right.mean()) < 0.03
        sure = answer.pixels.confidence > 0.7
        assert abs(said[sure].mean() - right[sure].mean()) < 0.05
    assert 0 < model.least_share < 0.75


def test_the_radars_points_are_as_sure_as_they_are_right_where_they_gather():
    rng = np.random.default_rng(1)
    wall = np.stack([np.full(200, 6.0), np.linspace(-4, 4, 200), np.zeros(200)], -1)

    def answer(_):
        alone = rng.uniform((1, -4, 0), (5, 4, 0), (30, 3))
        points = np.concatenate([wall + rng.normal(0, 0.05, wall.shape), alone])
        nothing = Judged(np.zeros((0, 3)), np.zeros(0), np.zeros(0, bool), wall)
        return Answer(0, nothing._replace(echoes=around(points, wall)), 0.1)

    groups = [[*answers(rng, 0.1, 0.9)], [answer(k) for k in range(6)]]
    model = with_scaled_confidence(MODEL, groups)
    plain = with_scaled_confidence(MODEL, groups[:1])
    assert plain.echoes is None and plain.least_alone == 0
    lone, gathered = np.interp(
        (0, 0.5), np.linspace(0, 1, 33), model.echoes.frequencies
    )
    assert lone < 0.2 and gathered > 0.8
    assert lone < model.echo_share * gathered < gathered


def test_what_is_wrong_away_from_the_radars_points_must_be_surer():
    rng = np.random.default_rng(2)
    wall = np.stack([np.full(400, 6.0), np.linspace(-4, 4, 400), np.zeros(400)], -1)
    model = dataclasses.replace(MODEL, least_share=0.0)

    def answer(right_alone):
        alone = np.stack([np.full(400, 2.0), *np.zeros((2, 400))], -1)
        alone += rng.normal(0, 0.3, alone.shape) * (1, 1, 0)
        truth = np.concatenate([wall, alone]) if right_alone else wall
        xyz = np.concatenate([wall, alone]).astype(np.float32)
        right = np.arange(800) < (800 if right_alone else 400)
        pixels = Judged(xyz, np.full(800, 0.5), right, truth)
        return Answer(0, pixels._replace(echoes=around(wall, truth)), 0.0)

    def found(right_alone):
        return with_echoes(model, [[answer(right_alone) for _ in range(4)]])

    assert found(right_alone=False).least_alone == THRESHOLDS[-1]
    assert found(right_alone=True).least_alone <= 0.5


@pytest.mark.parametrize("groups", [(), ([],)])
def test_without_a_pixel_the_model_stays_as_it_is(groups):
    assert with_scaled_confidence(MODEL, groups) is MODEL
