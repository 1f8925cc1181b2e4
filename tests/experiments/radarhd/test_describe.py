"""The confidence of planar models holds where two answers agree and where not."""

import numpy as np
import pytest

from experiments.radarhd.describe import Answer, confidence, with_scaled_confidence
from jradar.evaluation import Judged
from jradar.planar import LIDAR
from tests.models import tiny_planar_model

MODEL = tiny_planar_model()


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


@pytest.mark.parametrize("groups", [(), ([],)])
def test_without_a_pixel_the_model_stays_as_it_is(groups):
    assert with_scaled_confidence(MODEL, groups) is MODEL
