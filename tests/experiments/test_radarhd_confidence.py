"""Confidence of drawn cells: right within 0.2 m, and a frequency that was seen."""

import numpy as np
import pytest

from experiments.radarhd.cartesian import cartesian_points
from experiments.radarhd.confidence import (
    VALUES,
    confidence_table,
    counted,
    drawn_cells,
    fit_confidence,
)
from experiments.radarhd.pairs import LIDAR


def wall(row, value):
    image = np.zeros(LIDAR.shape)
    image[row] = value
    return image


def test_cells_within_20_centimetres_are_right():
    truth = cartesian_points(wall(100, 1) > 0)
    step = LIDAR.ranges[1]
    for rows, right in ((0, True), (4, True), (6, False), (-6, False)):
        assert (abs(rows * step) <= 0.2) == right
        cells = drawn_cells(wall(100 + rows, 0.6), 0.3, truth)
        assert len(cells.value) > 300
        np.testing.assert_allclose(cells.value, 0.6, atol=1 / 255)
        assert cells.right.mean() > 0.95 if right else cells.right.mean() < 0.05


def test_values_up_to_the_limit_are_not_drawn():
    image = wall(100, 0.2) + wall(150, 0.7)
    truth = cartesian_points(wall(150, 1) > 0)
    cells = drawn_cells(image, 0.1, truth)
    both, above = counted(cells, 0.1), counted(cells, 0.5)
    assert sum(both["drawn"]) == len(cells.value) > sum(above["drawn"]) > 300
    assert above["right"] == above["drawn"]
    assert np.flatnonzero(above["drawn"]).tolist() == [round(0.7 * 32)]
    assert not drawn_cells(image, 0.8, truth).value.size


def row(trajectory, drawn, right):
    counts = {"drawn": [0] * len(VALUES), "right": [0] * len(VALUES)}
    for place, (many, few) in enumerate(zip(drawn, right, strict=True)):
        counts["drawn"][16 * place], counts["right"][16 * place] = many, few
    return {"method": "a", "trajectory": trajectory, **counts}


def test_the_confidence_is_the_frequency_that_was_seen():
    """Low values are right in 10 %, high ones in 60 % of the cells."""
    seen = [row(1, (100, 50), (10, 30)), row(2, (100, 150), (10, 90))]
    confidence = fit_confidence([*seen, {"method": "a", "limit": 0.5}])
    table = confidence_table(seen, confidence, lambda row: str(row["trajectory"]))
    for line, cells, share in (("1", 150, 40 / 150), ("2", 250, 100 / 250)):
        wanted = f"| {line} | a | {cells} | "
        found = next(text for text in table.splitlines() if text.startswith(wanted))
        _, sure, right, error = map(float, found.split("|")[4:8])
        assert right == pytest.approx(100 * share, abs=0.05)
        assert sure == pytest.approx(right, abs=0.1) and error < 0.1
    # In a building where only half as many are right, the error says so.
    elsewhere = [row(3, (100, 100), (5, 30))]
    table = confidence_table(elsewhere, confidence, lambda row: "other")
    assert float(table.splitlines()[-1].split("|")[7]) == pytest.approx(17.5, abs=0.1)


def test_no_cell_is_no_error():
    confidence = fit_confidence([row(1, (0, 0), (0, 0))])
    assert confidence["a"].frequencies == (0.0, 1.0)
    assert "| 1 |" not in confidence_table([row(1, (0, 0), (0, 0))], confidence, str)
