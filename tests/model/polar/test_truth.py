"""A scan in the plane: heights, view, and pixels as RadarHD assigns them."""

import numpy as np

from jradar.model.grids.polar import LIDAR, lidar_image, true_points


def test_only_points_near_the_plane_and_in_view_are_true():
    kept = [[1.0, 2.0, 0.3], [9.9, -3.0, -0.3], [0.1, 10.0, 0.0]]
    others = [[1, 2, 0.31], [1, 2, -0.31], [-0.1, 1, 0], [10.1, 0, 0], [1, -10.1, 0]]
    beyond = [[9, 7, 0.0]]  # farther than 10.8 m
    found = true_points(np.array([*kept, *others, *beyond]))
    np.testing.assert_array_equal(found, np.array(kept) * [1, 1, 0])


def test_a_point_lies_in_the_pixel_at_or_beyond_it():
    random = np.random.default_rng(0)
    distance, azimuth = random.uniform(0.2, 9.9, 500), random.uniform(-1.5, 1.5, 500)
    flat = [distance * np.cos(azimuth), distance * np.sin(azimuth), 0 * azimuth]
    occupied = lidar_image(np.stack(flat, -1))
    rows, columns = np.nonzero(occupied)
    found = sorted(zip(LIDAR.ranges[rows], LIDAR.angles[columns], strict=True))
    assert 480 < len(found) <= 500
    for r, a in zip(distance, azimuth, strict=True):
        row = np.searchsorted(LIDAR.ranges, r)
        column = np.searchsorted(LIDAR.angles, a)
        assert occupied[row, column]
        assert 0 <= LIDAR.ranges[row] - r <= 0.043
        assert 0 <= LIDAR.angles[column] - a <= LIDAR.azimuth_step
    assert not lidar_image(np.zeros((0, 3))).any()
