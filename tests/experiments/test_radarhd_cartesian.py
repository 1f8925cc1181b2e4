"""RadarHD's grid and formulas against a loop over pixels, and what follows."""

import math

import numpy as np
import pytest

from experiments.radarhd.cartesian import cartesian_points, cells, to_cartesian
from experiments.radarhd.pairs import LIDAR, polar_to_points
from experiments.radarhd.report import building, tables_of
from experiments.radarhd.scores import plane_scores


def slow_points(image):
    """The grid of `radarhd_cartesian`'s docstring, pixel by pixel."""
    xs = [10.8 * i / 255 for i in range(256)]
    ys = [-10.8 + 21.6 * i / 511 for i in range(512)]
    cells = {}
    for row in range(256):
        for column in range(512):
            if image[row, column] > 0:
                angle = math.radians(-90 + 180 * column / 511)
                distance = 10.8 * row / 255
                x, y = distance * math.cos(angle), distance * math.sin(angle)
                # Half a micrometre: a value on the grid must not depend on rounding.
                i = next(i for i, value in enumerate(xs) if value >= x - 5e-7)
                j = next(j for j, value in enumerate(ys) if value >= y - 5e-7)
                cells[i, j] = image[row, column]
    found = sorted(cell for cell, grey in cells.items() if grey > 1)
    return np.array([[xs[i], ys[j], 0] for i, j in found] or [[0.0, 0.0, 0.0]])


def slow_distances(a, b):
    return [min(math.dist(point, other) for other in b) for point in a]


def sparse(seed, share=0.001):
    """A grey image of few pixels, not on the axes, where rounding decides the cell."""
    rng = np.random.default_rng(seed)
    image = np.zeros(LIDAR.shape, np.uint8)
    chosen = rng.random(LIDAR.shape) < share
    image[chosen] = rng.integers(1, 4, chosen.sum())
    image[0] = image[-1] = image[:, [0, -1]] = 0
    return image


def test_points_and_scores_are_those_of_a_loop_over_pixels():
    found, truth = sparse(0), sparse(1)
    clouds = [cartesian_points(image) for image in (found, truth)]
    slow = [slow_points(image) for image in (found, truth)]
    for fast, expected in zip(clouds, slow, strict=True):
        np.testing.assert_allclose(fast, expected, atol=1e-12)
    forth, back = slow_distances(*slow), slow_distances(*reversed(slow))
    scores = plane_scores(*clouds)
    expected = (np.mean(forth) + np.mean(back)) / 2
    assert scores["chamfer"] == pytest.approx(expected)
    expected = max(np.median(forth), np.median(back))
    assert scores["modified_hausdorff"] == pytest.approx(expected)
    near = [np.mean(np.array(distance) < 0.2) for distance in (forth, back)]
    expected = 2 * near[0] * near[1] / (near[0] + near[1])
    assert scores["f_score_0.2"] == pytest.approx(expected)


def test_the_last_of_several_pixels_in_a_cell_counts():
    image = np.zeros(LIDAR.shape, np.uint8)
    x, y = cells()
    same = (x[20, 300:-1] == x[20, 301:]) & (y[20, 300:-1] == y[20, 301:])
    column = 300 + int(np.argmax(same))  # two pixels 5 mm apart, in one cell
    image[20, column], image[20, column + 1] = 200, 1
    assert to_cartesian(image).max() == 1
    np.testing.assert_array_equal(cartesian_points(image), np.zeros((1, 3)))
    image[20, column + 1] = 2
    assert len(cartesian_points(image)) == 1 and cartesian_points(image).any()


def test_an_empty_image_is_the_one_point_at_the_origin():
    truth = np.zeros(LIDAR.shape, bool)
    truth[100, 256] = True
    scores = plane_scores(cartesian_points(truth & False), cartesian_points(truth))
    assert scores["chamfer"] == pytest.approx(4.25, abs=0.05)
    assert scores["f_score_0.5"] == 0


def test_far_pixels_count_more_on_the_even_grid():
    """Near the radar, a cell holds many pixels of an arc; far away, hardly two."""
    image = np.zeros(LIDAR.shape, bool)
    image[[10, 250]] = True
    near = [
        np.mean(np.hypot(points[:, 0], points[:, 1]) < 1)
        for points in (polar_to_points(image), cartesian_points(image))
    ]
    assert near[0] == pytest.approx(0.5) and near[1] < 0.1


def test_wrong_shape_is_named():
    with pytest.raises(ValueError, match=r"shape \(3, 4\), expected \(256, 512\)"):
        cartesian_points(np.zeros((3, 4), bool))


def test_tables_group_frames_by_building_and_trajectory():
    scores = dict.fromkeys(("chamfer", "modified_hausdorff", "f_score_0.1"), 0.1)
    rows = [
        {
            "protocol": protocol,
            "method": "a",
            "trajectory": trajectory,
            "frame": frame,
            "points": 3,
            **scores,
            "f_score_0.2": 0.5 if trajectory == 230 else 0.7,
            "f_score_0.5": 0.9,
        }
        for protocol in ("polar", "cartesian")
        for trajectory in (117, 230, 250)
        for frame in range(4)
    ]
    text = tables_of(rows, "cartesian", {"a": 0.5})
    lines = [line.split(" | ") for line in text.splitlines()]
    all_frames = next(line for line in lines if line[0] == "| a")
    assert all_frames[5].startswith("63.3") and all_frames[7] == "12"
    other = next(line for line in lines if line[0] == "| 227 to 246, another building")
    assert other[5].startswith("50.0") and other[7] == "4"
    assert any(line[0] == "| 250" for line in lines)
    assert building(140).startswith("112") and building(99) == "unknown building"
