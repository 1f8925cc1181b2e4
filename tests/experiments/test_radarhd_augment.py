"""Changes of RadarHD's pairs: each alters what its name says, alike in both images."""

import numpy as np
import pytest

from experiments.radarhd import augment as augmenting
from experiments.radarhd.pairs import LIDAR, RADAR, PolarItem


def pair_of(row, degrees):
    """One echo and one occupied pixel at a range row and an azimuth."""
    radar, occupied = np.zeros((*RADAR.shape, 1)), np.zeros((*LIDAR.shape, 1))
    for image, grid in ((radar, RADAR), (occupied, LIDAR)):
        column = int(np.argmin(np.abs(grid.angles - np.deg2rad(degrees))))
        image[row - 3 : row + 4, column] = 0.5 if image is radar else 1.0
    return PolarItem(radar.astype(np.float32), occupied.astype(np.float32))


def place(image, grid):
    row, column = np.nonzero(image[..., 0])[:2]
    return row.mean(), np.rad2deg(grid.angles[column].mean())


@pytest.mark.parametrize("seed", range(3))
def test_scaled_ranges_move_both_images_by_one_factor(seed):
    item = pair_of(100, 20)
    radar, occupied = augmenting.scale_ranges(np.random.default_rng(seed), *item)
    rows = place(radar, RADAR)[0], place(occupied, LIDAR)[0]
    assert rows[0] == rows[1] and 79 <= rows[0] <= 126 and rows[0] != 100
    assert place(radar, RADAR)[1] == pytest.approx(place(item.condition, RADAR)[1])


@pytest.mark.parametrize("seed", range(3))
def test_a_turn_moves_both_images_by_one_angle(seed):
    item = pair_of(100, 10)
    changed = augmenting.turn(np.random.default_rng(seed), *item)
    turns = [
        place(after, grid)[1] - place(before, grid)[1]
        for before, after, grid in zip(item, changed, (RADAR, LIDAR), strict=True)
    ]
    assert turns[0] == pytest.approx(turns[1], abs=0.2)  # half a LiDAR cell
    assert 2.6 < abs(turns[1]) < 29
    assert place(changed[1], LIDAR)[0] == 100


@pytest.mark.parametrize("seed", range(3))
def test_a_turn_leaves_no_part_of_the_view_empty(seed):
    full = [np.ones((*grid.shape, 1), np.float32) for grid in (RADAR, LIDAR)]
    for image in augmenting.turn(np.random.default_rng(seed), *full):
        assert image.all()


@pytest.mark.parametrize("seed", [3, 4, 7])  # 20, 14 and 26 degrees to the left
def test_what_a_turn_uncovers_is_the_mirror_image_of_the_view(seed):
    changed = augmenting.turn(np.random.default_rng(seed), *pair_of(100, -80))
    edges = []
    for image, grid in zip(changed, (RADAR, LIDAR), strict=True):
        columns = np.flatnonzero(image.any((0, 2)))
        assert len(columns) == 2
        edges.append(np.rad2deg(grid.angles[columns].mean()))
    assert edges[0] == pytest.approx(edges[1], abs=0.3) and -80 < edges[1] < -60


@pytest.mark.parametrize("name", ["gain", "speckle"])
def test_grey_values_change_and_stay_between_0_and_1(name):
    item = pair_of(100, 10)
    change = augmenting.AUGMENTATIONS[name]
    radar, occupied = change(np.random.default_rng(0), *item)
    np.testing.assert_array_equal(occupied, item.target)
    np.testing.assert_array_equal(radar > 0, item.condition > 0)
    assert radar.max() <= 1 and np.abs(radar - item.condition).max() > 0.01


def test_dropped_azimuths_are_neighbours():
    full = np.ones((*RADAR.shape, 1), np.float32)
    target = pair_of(100, 10).target
    radar, _ = augmenting.drop_azimuths(np.random.default_rng(0), full, target)
    dropped = np.flatnonzero(~radar.any((0, 2)))
    assert 1 <= len(dropped) <= augmenting.MOST_DROPPED and full.all()
    assert (np.diff(dropped) == 1).all()


@pytest.mark.parametrize("seed", range(3))
def test_a_pasted_sector_is_the_same_in_both_images(seed):
    """Of another pair, which has a wall at row 200, in place of one at row 100."""
    here, there = (
        PolarItem(np.zeros((*RADAR.shape, 1)), np.zeros((*LIDAR.shape, 1)))
        for _ in range(2)
    )
    for item, row in ((here, 100), (there, 200)):
        for image in item:
            image[row] = 1
    changed = augmenting.paste_sector(np.random.default_rng(seed), *here, there)
    ends = []
    for image, grid in zip(changed, (RADAR, LIDAR), strict=True):
        pasted = image[200, :, 0] == 1
        np.testing.assert_array_equal(image[100, :, 0] == 0, pasted)
        ends.append(np.rad2deg(grid.angles[np.flatnonzero(pasted)[[0, -1]]]))
        assert 27 < np.ptp(ends[-1]) < 90
    np.testing.assert_allclose(*ends, atol=3)
    assert here.condition[200].max() == 0


def test_half_of_the_items_change_and_none_without_names():
    item = pair_of(100, 10)
    rng = np.random.default_rng(0)
    assert augmenting.augmented(item, rng, names=(), others=[item]) is item
    changed = [
        augmenting.augmented(item, rng, names=("gain",), others=[item]) is not item
        for _ in range(100)
    ]
    assert 30 < sum(changed) < 70
