"""Matching in time: nearest scans, used once, within a tolerance; reasons for drops."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from jradar.data.frames import check_dropped, match_nearest

CLOSER = "its LiDAR scan is closer to another radar frame"
NONE, OUTSIDE = "no LiDAR scan within 50 ms", "outside the trajectory"


@pytest.mark.parametrize(
    ("radar", "lidar", "span", "pairs", "dropped"),
    [
        ([0, 0.1, 0.2], [0.21, 0.01, 0.09], (0, 1), ([0, 1, 2], [1, 2, 0]), {}),
        ([0, 0.03], [0.02], (0, 1), ([1], [0]), {0: CLOSER}),
        ([0, 1, 2], [0, 1.06, 2], (0, 1.5), ([0], [0]), {1: NONE, 2: OUTSIDE}),
    ],
)
def test_frames_get_their_nearest_scans_or_a_reason(radar, lidar, span, pairs, dropped):
    matches = match_nearest(np.array(radar, float), np.array(lidar, float), span=span)
    assert (matches.radar.tolist(), matches.lidar.tolist()) == pairs
    assert matches.dropped == dropped


STAMPS = st.floats(0, 1, width=16)
TIMES = st.integers(0, 12).flatmap(lambda n: arrays(float, n, elements=STAMPS))


@settings(max_examples=60, deadline=None)
@given(TIMES, TIMES)
def test_pairs_are_within_tolerance_unique_and_complete(radar, lidar):
    matches = match_nearest(radar, lidar, tolerance_s=0.1)
    assert len(set(matches.lidar.tolist())) == len(matches.lidar)
    assert (abs(radar[matches.radar] - lidar[matches.lidar]) <= 0.1).all()
    assert {*matches.radar.tolist(), *matches.dropped} == {*range(len(radar))}
    free = np.setdiff1d(np.arange(len(lidar)), matches.lidar)
    for frame in matches.dropped:  # a dropped frame has no free scan in reach
        assert (abs(lidar[free] - radar[frame]) > 0.1 - 1e-12).all()


def test_more_than_half_dropped_and_stamps_that_are_not_finite_are_an_error():
    check_dropped("run0", 2, {0: "late"})
    with pytest.raises(ValueError, match="2 of 3 .* do the two clocks agree"):
        check_dropped("run0", 3, {0: "late", 1: "late"})
    with pytest.raises(ValueError, match="1 of 2 LiDAR stamps"):
        match_nearest(np.zeros(1), np.array([np.nan, 0.0]))
