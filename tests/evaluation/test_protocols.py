"""Protocols: three points, whose scores by each definition are known by hand."""

import numpy as np
import pytest

from jradar.evaluation import protocols, score_points
from jradar.model.grids.polar import LIDAR
from jradar.options.protocols import PROTOCOLS

#                 right within 5 cm, 0.3 m too far, above the plane by 2 m
FOUND = np.array([[2.0, 0.0, 0.0], [4.0, 1.3, 0.0], [6.0, 0.0, 2.0]])
TRUTH = np.array([[2.05, 0.0, 0.0], [4.0, 1.0, 0.0], [6.0, 0.0, 0.0]])
FORTH = np.array([0.05, 0.3, 2.0])  # of each found point, and likewise back


def test_every_protocol_is_described_and_scores_alike():
    assert [*protocols.PROTOCOLS] == [*PROTOCOLS]
    for scored in protocols.PROTOCOLS.values():
        same = scored(TRUTH, TRUTH)
        assert same.keys() == score_points(TRUTH, TRUTH).keys()
        assert same["chamfer"] == same["modified_hausdorff"] == 0
        assert same["f_score_0.1"] == 1
        for found, truth in ((FOUND[:0], TRUTH), (FOUND, TRUTH[:0])):
            np.testing.assert_equal(scored(found, truth), score_points(found, truth))


def test_the_paper_sums_both_means_and_takes_the_larger_median():
    found = protocols.PROTOCOLS["paper"](FOUND, TRUTH)
    assert found["chamfer"] == pytest.approx(2 * FORTH.mean())
    assert found["modified_hausdorff"] == pytest.approx(0.3)
    assert found["f_score_0.1"] == pytest.approx(1 / 3)


def test_radarhd_sees_pixels_of_the_plane_and_halves():
    """The third found point is too high: the third true one is far from all."""
    found = protocols.radarhd(FOUND, TRUTH)
    step = 10.8 / 255
    forth = np.array([0.05, 0.3])
    back = np.array([0.05, 0.3, np.hypot(2.0, 1.3)])
    expected = (forth.mean() + back.mean()) / 2
    assert found["chamfer"] == pytest.approx(expected, abs=step)
    assert found["modified_hausdorff"] == pytest.approx(0.3, abs=2 * step)
    twice = np.repeat(FOUND, 5, 0) + 1e-4 * np.arange(15)[:, None]
    assert protocols.radarhd(twice, TRUTH)["chamfer"] == found["chamfer"]  # one pixel
    pixels = LIDAR.xyz[[40, 90], [200, 300]]
    assert protocols.radarhd(pixels + [1e-9, 0, 0], pixels)["chamfer"] < 2 * step


def test_rald_leaves_out_what_is_high_far_or_behind():
    beyond = [[15.9, 0, 0], [-1.0, 0, 0], [5.0, 0, 2.0], [0.1, 0, 0]]
    found = protocols.rald(np.vstack([FOUND, beyond]), np.vstack([TRUTH, beyond]))
    elevation = np.degrees(np.arctan2(2.0, 6.0))
    assert 18 < elevation < 20  # the third point is seen
    assert found["chamfer"] == pytest.approx(FORTH.mean())  # half of the sum
    wider = protocols.rald(np.vstack([FOUND, [15.8, 0, 0]]), TRUTH)
    assert wider["chamfer"] == pytest.approx(
        (FORTH.mean() + (FORTH.sum() + 9.8) / 4) / 2
    )


def test_radar_diffusion_is_flat_with_the_largest_distance_and_a_mixed_precision():
    found = protocols.radar_diffusion(FOUND, TRUTH)
    flat = np.array([0.05, 0.3, 0.0])
    assert found["chamfer"] == pytest.approx(2 * flat.mean())
    assert found["modified_hausdorff"] == pytest.approx(0.3)
    # Two right points, one missed true one; of four found points, two are right.
    more = protocols.radar_diffusion(np.vstack([FOUND, [9.0, 9.0, 0.0]]), TRUTH)
    assert more["f_score_0.1"] == pytest.approx(2 * (2 / 3) * 0.5 / (2 / 3 + 0.5))


def test_uppointr_counts_equal_voxels():
    found = protocols.uppointr(FOUND, TRUTH)
    assert found["f_score_0.1"] == pytest.approx(1 / 3)  # 2.00 and 2.05 are one voxel
    assert found["chamfer"] == pytest.approx((0 + 0.3 + 13 * 0.15) / 3, abs=0.06)
    apart = protocols.uppointr(FOUND + [0.15, 0, 0], FOUND)
    assert apart["f_score_0.1"] == 0 and apart["f_score_0.2"] == 1
