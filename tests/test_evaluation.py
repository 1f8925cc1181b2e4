"""Evaluation: rows per method and frame, means that count empty frames, the table."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.data import Pairs
from jradar.evaluation import markdown, score_frames, summarise
from jradar.range_image import ImageSpec, unproject
from jradar.types import PointCloud

IMAGE = ImageSpec(4, 8)


@pytest.fixture
def pairs():
    lidar = np.full((2, 4, 8), 5.0, np.float32)
    empty = PointCloud(np.zeros((2, 3, 3), np.float32), np.zeros((2, 3), bool))
    return Pairs(np.zeros((2, 4, 4, 3), np.float32), lidar, empty)


def test_perfect_and_empty_methods(pairs):
    methods = {
        "none": lambda key, pair: pair.radar,
        "perfect": lambda key, pair: unproject(jnp.asarray(pair.lidar), IMAGE),
        "far": lambda key, pair: unproject(jnp.asarray(pair.lidar) + 0.3, IMAGE),
    }
    scores = [*score_frames(jax.random.key(0), pairs, methods, fine=IMAGE)]
    assert [(s["method"], s["frame"]) for s in scores[:3]] == [
        ("none", 0), ("perfect", 0), ("far", 0)
    ]  # fmt: skip
    none, perfect, far = summarise(scores)
    assert none["empty"] == 2 and np.isnan(none["chamfer"])
    assert perfect["chamfer"] == pytest.approx(0, abs=1e-6) and perfect["empty"] == 0
    assert perfect["f_score_0.1"] == 1 and perfect["points"] == 32
    assert far["modified_hausdorff"] == pytest.approx(0.3, rel=1e-4)
    assert far["f_score_0.2"] == 0 and far["f_score_0.5"] == 1
    table = markdown([none, perfect, far]).splitlines()
    assert len(table) == 5 and len({line.count("|") for line in table}) == 1
    assert "| perfect | 0.000 | 0.000 | 100.0 |" in table[3]


def test_frames_with_empty_clouds_do_not_enter_the_mean():
    row = {"method": "a", "modified_hausdorff": 1.0, "points": 3}
    row |= {f"f_score_{limit}": 0.5 for limit in (0.1, 0.2, 0.5)}
    rows = [{**row, "chamfer": 2.0}, {**row, "chamfer": float("nan"), "points": 0}]
    (mean,) = summarise(rows)
    assert mean["chamfer"] == 2 and mean["points"] == 3
    assert (mean["frames"], mean["empty"]) == (2, 1)
