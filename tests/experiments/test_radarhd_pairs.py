"""RadarHD: the folder and the packed file give the same pairs; the polar grid."""

import numpy as np
import pytest
from PIL import Image
from scipy.spatial import KDTree

from experiments.radarhd.pairs import (
    LIDAR,
    RADAR,
    PolarItems,
    open_radarhd,
    polar_to_points,
)

KEYS = [(7, 2), (7, 10), (12, 0)]  # in numeric, not alphabetic order


@pytest.fixture(scope="module")
def images():
    rng = np.random.default_rng(0)
    radar = rng.integers(0, 256, (3, *RADAR.shape), np.uint8)
    return radar, rng.random((3, *LIDAR.shape)) < 0.01


@pytest.fixture(scope="module")
def folder(images, tmp_path_factory):
    root = tmp_path_factory.mktemp("dataset_5")
    for kind in ("radar", "lidar"):
        (root / "train" / kind).mkdir(parents=True)
    for (trajectory, frame), radar, lidar in zip(KEYS, *images, strict=True):
        name = f"{trajectory:03d}_{frame}.png"
        Image.fromarray(radar).save(root / "train" / "radar" / f"R_{name}")
        Image.fromarray((lidar * 77).astype(np.uint8)).save(
            root / "train" / "lidar" / f"L_{name}"
        )
    return root


@pytest.fixture(scope="module")
def packed(images, tmp_path_factory):
    path = tmp_path_factory.mktemp("packed") / "train.npz"
    order = [2, 0, 1]
    radar, lidar = (image[order] for image in images)
    trajectory, frame = np.array(KEYS)[order].T
    np.savez(
        path,
        radar=radar,
        lidar_packed=np.packbits(lidar, axis=-1),
        trajectory=trajectory,
        frame=frame,
    )
    return path


def test_both_ways_give_the_same_pairs_in_order(folder, packed, images):
    for path in (folder, packed):
        pairs = open_radarhd(path)
        assert pairs.keys.tolist() == [[*key] for key in KEYS]
        for i, pair in enumerate(pairs):
            np.testing.assert_array_equal(pair.radar, images[0][i])
            np.testing.assert_array_equal(pair.lidar, images[1][i])
            assert (pair.trajectory, pair.frame) == KEYS[i]


def test_trajectories_are_taken_apart(packed):
    pairs = open_radarhd(packed)
    assert pairs.of([12]).keys.tolist() == [[12, 0]]
    assert pairs.without([12])[1].frame == 10
    with pytest.raises(ValueError, match=r"no trajectory 8, expected of \[7, 12\]"):
        pairs.of([7, 8])


def test_history_stays_within_its_trajectory(packed, images):
    pairs = open_radarhd(packed)
    np.testing.assert_array_equal(
        pairs.history(1, 3), np.stack([images[0][1], images[0][0], images[0][0]], -1)
    )
    np.testing.assert_array_equal(
        pairs.without([7]).history(0, 2), np.stack([images[0][2]] * 2, -1)
    )


@pytest.mark.parametrize("degrees", [20, -20])
def test_turned_pairs_hold_the_same_walls_at_another_angle(packed, degrees):
    pairs = open_radarhd(packed)
    angle = degrees / abs(degrees) * 7 * 180 / 63  # whole radar cells
    whole, turned = polar_to_points(pairs[1].lidar), pairs.turned(degrees)
    points = polar_to_points(turned[1].lidar)
    cos, sin = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
    expected = whole @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    seen = expected[expected[:, 0] > 0.05]
    distance, _ = KDTree(points).query(seen)
    assert len(seen) > 100 and distance.max() < 10.8 * np.deg2rad(0.2)
    np.testing.assert_array_equal(
        turned.history(1, 2)[:, 7:-7],
        np.roll(pairs.history(1, 2), 7 if degrees > 0 else -7, 1)[:, 7:-7],
    )
    assert turned.digest == pairs.digest
    with pytest.raises(ValueError, match="100 degrees, expected -90 to 90"):
        pairs.turned(100)


def test_points_lie_on_the_grid():
    image = np.zeros(LIDAR.shape, bool)
    image[255, 0] = image[0, 100] = image[100, 511] = True
    xyz = polar_to_points(image)
    np.testing.assert_allclose(xyz[0], 0, atol=1e-12)
    np.testing.assert_allclose(xyz[1], [0, 10.8 * 100 / 255, 0], atol=1e-12)
    np.testing.assert_allclose(xyz[2], [0, -10.8, 0], atol=1e-12)


def test_mirrored_items_are_turned_left_and_right(packed):
    pairs = open_radarhd(packed)
    items = PolarItems(pairs, history=2, mirror=True)
    assert len(items) == 2 * len(pairs)
    plain, mirrored = items[1], items[1 + len(pairs)]
    np.testing.assert_array_equal(mirrored.target, plain.target[:, ::-1])
    np.testing.assert_array_equal(mirrored.condition, plain.condition[:, ::-1])
    assert plain.condition.shape == (256, 64, 2) and plain.condition.max() <= 1
    assert set(np.unique(plain.target)) == {0.0, 1.0}


def test_the_digest_is_of_the_pairs(folder, packed):
    pairs = open_radarhd(folder)
    assert pairs.digest == open_radarhd(packed).digest != pairs.of([7]).digest


def test_what_is_missing_or_broken_is_named(folder, packed, tmp_path):
    with pytest.raises(ValueError, match="does not contain test/radar and test/lidar"):
        open_radarhd(folder, split="test")
    with pytest.raises(FileNotFoundError, match="nowhere"):
        open_radarhd(tmp_path / "nowhere")
    torn = tmp_path / "torn.npz"
    torn.write_bytes(packed.read_bytes()[:-50])
    with pytest.raises(ValueError, match="not a packed file"):
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
    xyz = polar_to_points(pair.lidar)
    assert np.linalg.norm(xyz, axis=1).max() <= 10.8 + 1e-9
