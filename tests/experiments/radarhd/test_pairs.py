"""RadarHD: folder and packed file give the same pairs; what training may change."""

import math

import numpy as np
import pytest
from PIL import Image
from scipy.spatial import KDTree

from experiments.radarhd import pairs as module
from experiments.radarhd.pairs import (
    Alternating,
    PolarItems,
    RadarHD,
    open_radarhd,
    write_pair,
)
from experiments.radarhd.scores import polar_points
from jradar.data import Batch
from jradar.model.grids.polar import LIDAR, RADAR

KEYS = [(7, 2), (7, 10), (12, 0)]  # in numeric, not alphabetic order


@pytest.fixture(scope="module")
def images():
    rng = np.random.default_rng(0)
    radar = rng.integers(0, 256, (3, *RADAR.shape), np.uint8)
    return radar, rng.random((3, *LIDAR.shape)) < 0.01


@pytest.fixture(scope="module")
def folder(images, tmp_path_factory):
    root = tmp_path_factory.mktemp("dataset_5")
    for kind, pictures in zip(("radar", "lidar"), images, strict=True):
        (root / "train" / kind).mkdir(parents=True)
        for (trajectory, frame), picture in zip(KEYS, pictures, strict=True):
            grey = picture if kind == "radar" else (picture * 77).astype(np.uint8)
            name = f"{kind[0].upper()}_{trajectory:03d}_{frame}.png"
            Image.fromarray(grey).save(root / "train" / kind / name)
    return root


@pytest.fixture(scope="module")
def packed(images, tmp_path_factory):
    path = tmp_path_factory.mktemp("packed") / "train.npz"
    order = [2, 0, 1]
    arrays = {"radar": images[0][order]}
    arrays["lidar_packed"] = np.packbits(images[1][order], axis=-1)
    arrays["trajectory"], arrays["frame"] = np.array(KEYS)[order].T
    np.savez(path, **arrays)
    return path


def test_both_ways_give_the_same_pairs_in_order(folder, packed, images):
    for path in (folder, packed):
        pairs = open_radarhd(path)
        assert pairs.keys.tolist() == [[*key] for key in KEYS]
        for i, pair in enumerate(pairs):
            np.testing.assert_array_equal(pair.radar, images[0][i])
            np.testing.assert_array_equal(pair.lidar, images[1][i])
            assert (pair.trajectory, pair.frame) == KEYS[i]
    assert pairs.digest == open_radarhd(folder).digest != pairs.of([7]).digest


def test_written_pairs_are_read_again(packed, tmp_path):
    pairs, xyz = open_radarhd(packed), np.ones((5, 3), np.float32)
    assert pairs[0].points is None
    for pair in pairs:
        known = pair._replace(points=xyz * pair.frame) if pair.trajectory == 7 else pair
        write_pair(tmp_path, known)
    found = open_radarhd(tmp_path)
    assert found.digest == pairs.digest
    for written, pair in zip(found, pairs, strict=True):
        np.testing.assert_array_equal(written.radar, pair.radar)
        np.testing.assert_array_equal(written.lidar, pair.lidar)
    assert found.of([12])[0].points is None
    np.testing.assert_array_equal(found.of([7])[1].points, 10 * xyz)
    assert found.rotated(20)[0].points is found.scaled(2)[0].points is None
    (tmp_path / "train" / "points" / "P_7_10.npz").write_bytes(b"PK")
    with pytest.raises(ValueError, match="P_7_10.npz is damaged or not a file of po"):
        _ = found[1]
    (tmp_path / "train" / "radar" / "R_7_2.png").unlink()  # written last
    assert open_radarhd(tmp_path).keys.tolist() == [[7, 10], [12, 0]]


def test_items_alternate_and_the_second_ones_start_anew():
    assert [*Alternating("abc", "xy")] == ["a", "x", "b", "y", "c", "x"]


def test_trajectories_are_taken_apart(packed):
    pairs = open_radarhd(packed)
    assert pairs.of([12]).keys.tolist() == [[12, 0]]
    assert pairs.of([12, 3], without=True)[1].frame == 10
    with pytest.raises(ValueError, match=r"no trajectory 8, expected of \[7, 12\]"):
        pairs.of([7, 8])


def test_history_stays_within_its_trajectory_and_mirror_images_follow(packed, images):
    pairs = open_radarhd(packed)
    items = PolarItems(pairs, history=3, mirror=True)
    assert len(items) == 2 * len(pairs)
    past = np.stack([images[0][1], images[0][0], images[0][0]], -1)
    np.testing.assert_allclose(items[1].condition, past / 255, atol=1e-7)
    np.testing.assert_array_equal(items[1].target[..., 0], images[1][1])
    for plain, mirrored in zip(items[1], items[1 + len(pairs)], strict=True):
        np.testing.assert_array_equal(mirrored, plain[:, ::-1])
    later = PolarItems(pairs.of([7], without=True), history=2)[0].condition
    np.testing.assert_array_equal(later[..., 0], later[..., 1])


@pytest.mark.parametrize("degrees", [20, -20])
def test_rotated_pairs_hold_the_same_walls_at_another_angle(packed, degrees):
    pairs = open_radarhd(packed)
    cells = 7 if degrees > 0 else -7  # whole radar cells
    angle = np.deg2rad(cells * 180 / 63)
    whole, rotated = polar_points(pairs[1].lidar), pairs.rotated(degrees)
    cos, sin = np.cos(angle), np.sin(angle)
    expected = whole @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    seen = expected[expected[:, 0] > 0.05]
    distance, _ = KDTree(polar_points(rotated[1].lidar)).query(seen)
    assert len(seen) > 100 and distance.max() < 10.8 * np.deg2rad(0.2)
    moved = np.roll(pairs[1].radar, cells, 1)[:, 7:-7]
    np.testing.assert_array_equal(rotated[1].radar[:, 7:-7], moved)
    with pytest.raises(ValueError, match="100 degrees, expected -90 to 90"):
        pairs.rotated(100)


@pytest.mark.parametrize("factor", [0.7, 1.4])
def test_scaled_pairs_hold_the_same_walls_at_another_distance(packed, factor):
    pairs = open_radarhd(packed)
    expected = factor * polar_points(pairs[1].lidar)
    seen = expected[np.linalg.norm(expected, axis=-1) < 10.7]
    distance, _ = KDTree(polar_points(pairs.scaled(factor)[1].lidar)).query(seen)
    assert len(seen) > 100 and distance.max() < 0.03  # rows are 0.042 m apart
    rows = np.arange(0, 150, 10)
    moved = np.round(factor * rows).astype(int)
    radar = pairs.scaled(factor)[1].radar
    expected = pairs[1].radar[np.round(moved / factor).astype(int)]
    np.testing.assert_array_equal(radar[moved], expected)
    beyond = radar[np.arange(256) / factor > 255.5]
    assert not beyond.any() and (len(beyond) > 0) == (factor < 1)
    with pytest.raises(ValueError, match=r"factor = 0, expected 0.1 to 10"):
        pairs.scaled(0)


def test_what_is_missing_or_broken_is_named(folder, packed, tmp_path):
    with pytest.raises(ValueError, match="does not contain test/radar and test/lidar"):
        open_radarhd(folder, split="test")
    with pytest.raises(FileNotFoundError, match="nowhere"):
        open_radarhd(tmp_path / "nowhere")
    torn = tmp_path / "torn.npz"
    torn.write_bytes(packed.read_bytes()[:-50])
    with pytest.raises(ValueError, match="not a packed file"):
        open_radarhd(torn)
    with np.load(packed) as arrays:
        np.savez(torn, **{**arrays, "frame": arrays["frame"][:1]})
    with pytest.raises(ValueError, match="torn.npz is damaged or not a packed file"):
        open_radarhd(torn)
    with np.load(packed) as arrays:
        np.savez(torn, **{**arrays, "radar": arrays["radar"][:, 1:]})
    with pytest.raises(ValueError, match=r"shapes \(\(3, 255, 64\)"):
        open_radarhd(torn)


@pytest.mark.parametrize("damage", ["remove", "truncate", "resize", "text"])
def test_a_damaged_image_is_named(damage, tmp_path):
    for kind, shape in (("radar", RADAR.shape), ("lidar", LIDAR.shape)):
        path = tmp_path / "train" / kind / f"{kind[0].upper()}_1_1.png"
        path.parent.mkdir(parents=True)
        Image.fromarray(np.zeros(shape, np.uint8)).save(path)
    if damage == "remove":
        path.unlink()
    elif damage == "truncate":
        path.write_bytes(path.read_bytes()[:60])
    elif damage == "resize":
        Image.fromarray(np.zeros((5, 5), np.uint8)).save(path)
    else:
        path.write_text("not an image")
    with pytest.raises(ValueError, match="L_1_1.png"):
        _ = open_radarhd(tmp_path)[0]


def test_the_shared_pairs(samples):
    pairs = open_radarhd(samples / "radarhd" / "train_every4.npz")
    assert len(pairs) == 5696
    assert np.unique(pairs.keys[:, 0]).size == 25
    pair = pairs.of([136])[10]
    assert pair.lidar.any() and pair.radar.any()
    assert np.linalg.norm(polar_points(pair.lidar), axis=1).max() <= 10.8 + 1e-9


def item_of(row, degrees):
    """One echo and one occupied pixel at a range row and an azimuth."""
    images = [np.zeros((*grid.shape, 1), np.float32) for grid in (RADAR, LIDAR)]
    for image, grid, value in zip(images, (RADAR, LIDAR), (0.5, 1.0), strict=True):
        column = int(np.argmin(np.abs(grid.angles - np.deg2rad(degrees))))
        image[row - 3 : row + 4, column] = value
    return Batch(*images)


def place(image, grid):
    row, column = np.nonzero(image[..., 0])
    return row.mean(), np.rad2deg(grid.angles[column].mean())


def rotated(seed, item):
    return module.rotated_at_random(Batch(*item), np.random.default_rng(seed))


@pytest.mark.parametrize("seed", [2, 3, 8])
def test_a_rotation_moves_both_images_by_one_angle_and_empties_no_part(seed):
    item = item_of(100, 10)
    turns = [
        place(after, grid)[1] - place(before, grid)[1]
        for before, after, grid in zip(
            item, rotated(seed, item), (RADAR, LIDAR), strict=True
        )
    ]
    assert turns[0] == pytest.approx(turns[1], abs=0.2)  # half a LiDAR cell
    assert 2.6 < abs(turns[1]) < 57.4
    full = [np.ones((*grid.shape, 1), np.float32) for grid in (RADAR, LIDAR)]
    assert all(image.all() for image in rotated(seed, full))


@pytest.mark.parametrize("seed", [171, 49])  # 26 and 40 degrees to the left
def test_what_a_rotation_uncovers_is_the_mirror_image_of_the_view(seed):
    edges = []
    images = rotated(seed, item_of(100, -80))
    for image, grid in zip(images, (RADAR, LIDAR), strict=True):
        columns = np.flatnonzero(image.any((0, 2)))
        assert len(columns) == 2
        edges.append(np.rad2deg(grid.angles[columns].mean()))
    assert edges[0] == pytest.approx(edges[1], abs=0.3) and -80 < edges[1] < -45


def test_half_of_the_items_are_rotated():
    item = item_of(100, 10)
    assert 30 < sum(rotated(s, item).target is item.target for s in range(100)) < 70


@pytest.fixture(scope="module")
def drive():
    """Two trajectories of ten frames; the radar's pixels are the number of the pair."""
    keys = [(trajectory, frame) for trajectory in (1, 2) for frame in range(10)]
    return RadarHD(
        keys,
        lambda i: np.full(RADAR.shape, i, np.uint8),
        lambda i: np.arange(math.prod(LIDAR.shape)).reshape(LIDAR.shape) % 97 == 1,
    )


def seen_frames(item):
    return np.round(255 * item.condition[0, 0]).astype(int).tolist()


@pytest.mark.parametrize(
    ("speed", "frames"),
    [
        (1, [17, 16, 15, 14, 13]),
        (0, [17] * 5),
        (0.5, [17, 17, 16, 15, 15]),  # halves go to the even number
        (2, [17, 15, 13, 11, 10]),  # the first frame stands for those before it
        (-1, [17, 18, 19, 19, 19]),
    ],
)
def test_a_history_at_another_speed_has_other_frames_of_its_trajectory(
    drive, speed, frames
):
    items = PolarItems(drive, history=5)
    assert seen_frames(items.at_speed(17, speed)) == frames
    np.testing.assert_array_equal(items.at_speed(17, speed).target, items[17].target)


def test_varied_items_show_other_drives_and_other_places(drive):
    items = PolarItems(drive, history=5, mirror=True)
    random = np.random.default_rng(0)
    drawn = [items.varied(17, random) for _ in range(300)]
    histories = [seen_frames(item) for item in drawn]
    assert {frames[0] for frames in histories} == {17}
    share = {
        "as recorded": np.mean(
            [frames == [17, 16, 15, 14, 13] for frames in histories]
        ),
        "standing": np.mean([frames == [17] * 5 for frames in histories]),
        "backwards": np.mean([frames[-1] > 17 for frames in histories]),
        "same target": np.mean(
            [np.array_equal(item.target, items[17].target) for item in drawn]
        ),
    }
    expected = {  # a half and some of other speeds; a half of a half
        "as recorded": 0.52,
        "standing": 0.17,
        "backwards": 0.16,
        "same target": 0.26,
    }
    assert share == pytest.approx(expected, abs=0.1)


def test_of_two_sequences_every_other_item_is_varied(drive):
    first = PolarItems(drive.of([1]), history=1)
    both = Alternating(first, PolarItems(drive.of([2]), history=1))
    random = np.random.default_rng(5)
    seen = [seen_frames(both.varied(i, random))[0] for i in (0, 1, 2, 19)]
    assert seen == [0, 10, 1, 19]
