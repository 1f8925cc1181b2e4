"""RadarHD's grid and formulas against a loop over pixels; limits."""

import math

import jax.numpy as jnp
import numpy as np
import pytest

from experiments.configs import radarhd
from experiments.radarhd import report, scores
from experiments.radarhd.pairs import open_radarhd
from experiments.radarhd.scores import cartesian_points, polar_points
from jradar.evaluation import score_points
from jradar.model.grids.polar import LIDAR
from tests.experiments.radarhd.conftest import shrink


def slow_points(image):
    """The grid of the module's docstring, pixel by pixel."""
    xs = [10.8 * i / 255 for i in range(256)]
    ys = [-10.8 + 21.6 * i / 511 for i in range(512)]
    found = set()
    for row, column in np.argwhere(image).tolist():
        angle = math.radians(-90 + 180 * column / 511)
        distance = 10.8 * row / 255
        x, y = distance * math.cos(angle), distance * math.sin(angle)
        # Half a micrometre: a value on the grid must not depend on rounding.
        i = next(i for i, value in enumerate(xs) if value >= x - 5e-7)
        j = next(j for j, value in enumerate(ys) if value >= y - 5e-7)
        found.add((i, j))
    return np.array([[xs[i], ys[j], 0] for i, j in sorted(found)])


def sparse(seed, share=0.001):
    """An image of few pixels, not on the axes, where rounding decides the cell."""
    image = np.random.default_rng(seed).random(LIDAR.shape) < share
    image[0] = image[-1] = image[:, [0, -1]] = False
    return image


def test_points_and_scores_are_those_of_a_loop_over_pixels():
    images = sparse(0), sparse(1)
    clouds = [cartesian_points(image) for image in images]
    slow = [slow_points(image) for image in images]
    for fast, expected in zip(clouds, slow, strict=True):
        np.testing.assert_allclose(fast, expected, atol=1e-12)
    forth, back = (
        [min(math.dist(point, other) for other in b) for point in a]
        for a, b in (slow, slow[::-1])
    )
    found = score_points(*clouds)
    assert found["chamfer"] == pytest.approx(np.mean(forth) + np.mean(back))
    expected = max(np.median(forth), np.median(back))
    assert found["modified_hausdorff"] == pytest.approx(expected)
    near = [np.mean(np.array(distance) < 0.2) for distance in (forth, back)]
    expected = 2 * near[0] * near[1] / (near[0] + near[1])
    assert found["f_score_0.2"] == pytest.approx(expected)


def test_polar_points_lie_on_the_grid():
    image = np.zeros(LIDAR.shape, bool)
    image[255, 0] = image[0, 100] = image[100, 511] = True
    expected = [[0, 0, 0], [0, 10.8 * 100 / 255, 0], [0, -10.8, 0]]
    np.testing.assert_allclose(polar_points(image), expected, atol=1e-12)


def test_an_empty_image_is_the_one_point_at_the_origin():
    image = np.zeros(LIDAR.shape, bool)
    np.testing.assert_array_equal(cartesian_points(image), np.zeros((1, 3)))
    assert polar_points(image).shape == (0, 3)


def row(trajectory=1, frame=0, **fields):
    """A row of scores."""
    place = {"scene": scores.building(trajectory), "sequence": str(trajectory)}
    counts = {"points": 3, "truth_points": 5, "milliseconds": np.nan}
    values = {"truth": "cartesian", "method": "a", "frame": frame, "limit": 0.5}
    distances = dict.fromkeys(("chamfer", "modified_hausdorff"), 0.1)
    f_scores = dict.fromkeys((f"f_score_{limit}" for limit in (0.1, 0.2, 0.5)), 0.5)
    return {**place, **counts, **values, **distances, **f_scores, **fields}


def test_the_limit_with_the_best_mean_is_chosen():
    tried = {0.1: (0.9, 0.1), 0.5: (0.6, 0.6), 0.9: (0.0, 0.9)}
    rows = [
        row(limit=limit, frame=frame, **{"f_score_0.2": score})
        for limit, found in tried.items()
        for frame, score in enumerate(found)
    ]
    limits = scores.choose_limits(rows)
    assert limits == {"cartesian": {"a": 0.5}}
    assert [r["f_score_0.2"] for r in scores.at_limits(rows, limits)] == [0.6, 0.6]


def test_rows_of_drawn_images_follow_the_rules_of_the_protocols(walls):
    """One method draws the truth 3 rows farther off, the other one nothing."""
    pairs = open_radarhd(walls).of([136, 138])

    def answers(_key, condition):
        # Where the radar saw its walls, in the middle of 3 rows.
        near = np.argmax(np.asarray(condition).max((2, 3)), 1) + 1
        image = (np.arange(256)[:, None] == near[:, None, None] + 3) * np.ones(512)
        yield "farther", jnp.asarray(image)
        yield "nothing", jnp.zeros_like(image)

    config = shrink(radarhd.get_config(), walls)
    limits = {name: {"farther": 0.5, "nothing": 0.5} for name in scores.PROTOCOLS}
    rows = [*scores.score_pairs(config, pairs, answers, every=1, limits=limits)]
    assert len(rows) == len(pairs) * 2 * 2
    by = {(r["truth"], r["method"], r["sequence"], r["frame"]): r for r in rows}
    found = by["polar", "farther", "138", 1]
    step = 3 * 10.8 / 255
    assert found["chamfer"] == pytest.approx(step, rel=0.01)  # not the sum
    assert found["points"] == found["truth_points"] == 512
    assert found["f_score_0.1"] == 0 and found["f_score_0.2"] == 1
    nothing = by["polar", "nothing", "138", 1]
    assert np.isnan(nothing["chamfer"]) and nothing["f_score_0.5"] == 0
    nothing = by["cartesian", "nothing", "138", 1]
    assert nothing["chamfer"] > 3 and nothing["points"] == 0
    tables = report.protocol_tables(rows, "polar", limits)
    assert f"| farther | {step:.3f} " in tables and "| 138 | nothing | – |" in tables
    assert "| 4 | 4 |\n" in tables  # frames of the second, of which all are empty
    quickest = scores.score_pairs(config, pairs, answers, every=2, methods=1)
    assert {r["method"] for r in quickest} == {"farther"}


def test_tables_group_frames_by_building_and_trajectory():
    rows = [
        row(trajectory, frame, **{"f_score_0.2": 0.5 if trajectory == 230 else 0.7})
        for trajectory in (117, 230, 250)
        for frame in range(4)
    ]
    text = report.protocol_tables(rows, "cartesian", {"cartesian": {"a": 0.5}})
    lines = [line.split(" | ") for line in text.splitlines()]
    all_frames = next(line for line in lines if line[0] == "| a")
    assert all_frames[4].startswith("63.3") and all_frames[7] == "12"
    other = next(line for line in lines if line[0] == "| 227 to 246, another building")
    assert other[5].startswith("50.0") and other[8] == "4"
    assert any(line[0] == "| 250" for line in lines)
    assert scores.building(200) == "unknown building"


def test_the_worst_frames_are_of_different_trajectories(walls):
    pairs = open_radarhd(walls)
    score = "f_score_0.2"
    rows = [row(136, 0, **{score: 0.3}), row(136, 1, **{score: 0.2})]
    rows += [row(1, 1, **{score: 0.9}), row(138, 0, **{score: 0.25})]
    rows.insert(0, row(140, method="other", **{score: 0.0}))
    worst = report.worst_frames(pairs, rows)
    assert pairs.keys[worst].tolist() == [[136, 1], [138, 0], [1, 1]]
