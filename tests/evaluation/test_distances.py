"""Rings around the radar: closed forms, and points on both sides of an edge."""

import numpy as np
import pytest

from jradar.evaluation import ring_edges, score_rings

EDGES = (0.0, 3.0, 6.0)


def ahead(*metres):
    return np.array([[x, 0.0, 0.0] for x in metres])


def test_a_ring_has_its_own_precision_and_recall():
    found, truth = ahead(1, 1.5, 4), ahead(1, 2, 2.5, 4, 5)
    near, far = score_rings(found, truth, edges=EDGES)
    # 1 of 2 right and 1 of 3 found; 1 of 1 and 1 of 2.
    assert near["f_score_0.2"] == pytest.approx(2 * (1 / 2) * (1 / 3) / (1 / 2 + 1 / 3))
    assert far["f_score_0.2"] == pytest.approx(2 * 1 * (1 / 2) / (1 + 1 / 2))
    assert (near["points"], near["truth_points"]) == (2, 3)
    assert (far["distance"], far["points"], far["truth_points"]) == ("3 to 6 m", 1, 2)


def test_a_true_point_beyond_the_edge_counts():
    near, far = score_rings(ahead(2.95), ahead(3.05), edges=EDGES)
    assert np.isnan(near["f_score_0.2"]) and near["points"] == 1
    assert far["f_score_0.2"] == 0 and far["truth_points"] == 1  # nothing found there
    near, far = score_rings(ahead(2.95, 3.5), ahead(2.9, 3.05), edges=EDGES)
    assert near["f_score_0.2"] == 1 and far["f_score_0.2"] == 0


def test_a_point_on_an_edge_is_of_the_ring_that_begins_there():
    near, far = score_rings(ahead(0, 3), ahead(0, 3, 6), edges=EDGES)
    assert (near["points"], near["truth_points"]) == (1, 1)
    assert (far["points"], far["truth_points"]) == (1, 1)  # 6 m are beyond all rings


def test_rings_end_with_the_view():
    assert ring_edges(12.0) == (0.0, 3.0, 6.0, 9.0, 12.0)
