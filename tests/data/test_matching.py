"""Matching in time: nearest scans, used once, within a tolerance; reasons for drops."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from jradar.data.frames import check_dropped, match_nearest


def test_each_frame_gets_its_nearest_scan():
    matches = match_nearest(np.array([0.0, 0.1, 0.2]), np.array([0.21, 0.01, 0.09]))
    np.testing.assert_array_equal(matches.radar, [0, 1, 2])
    np.testing.assert_array_equal(matches.lidar, [1, 2, 0])
    assert matches.dropped == {}


def test_one_scan_goes_to_the_closer_of_two_frames():
    matches = match_nearest(np.array([0.0, 0.03]), np.array([0.02]))
    np.testing.assert_array_equal(matches.radar, [1])
    assert "closer" in matches.dropped[0]


def test_frames_without_scan_or_outside_the_trajectory_are_named():
    radar, lidar = np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.06, 2.0])
    matches = match_nearest(radar, lidar, span=(0.0, 1.5))
    assert matches.radar.tolist() == [0]
    reasons = {1: "no LiDAR scan within 50 ms", 2: "outside the trajectory"}
    assert matches.dropped == reasons


TIMES = st.integers(0, 12).flatmap(
    lambda n: arrays(float, n, elements=st.floats(0, 1, width=16))
)


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


def test_more_than_half_dropped_is_an_error():
    check_dropped("run0", 2, {0: "late"})
    with pytest.raises(ValueError, match="2 of 3 .* do the two clocks agree"):
        check_dropped("run0", 3, {0: "late", 1: "late"})


def test_stamps_must_be_finite():
    with pytest.raises(ValueError, match="1 of 2 LiDAR stamps"):
        match_nearest(np.zeros(1), np.array([np.nan, 0.0]))
