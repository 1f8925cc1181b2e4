"""RadarHD: the folder and the packed file give the same pairs; the polar grid."""

import math

import numpy as np
import pytest
from PIL import Image

from experiments.radarhd_pairs import (
    LIDAR,
    RADAR,
    PolarSpec,
    open_radarhd,
    points_to_polar,
    polar_to_points,
)

KEYS = [(7, 2), (7, 10), (12, 0)]  # numeric order, not that of the names


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
    with pytest.raises(ValueError, match=r"no trajectory 8, there are \[7, 12\]"):
        pairs.of([7, 8])


def test_history_stays_within_its_trajectory(packed, images):
    pairs = open_radarhd(packed)
    np.testing.assert_array_equal(
        pairs.history(1, 3), np.stack([images[0][1], images[0][0], images[0][0]], -1)
    )
    np.testing.assert_array_equal(
        pairs.without([7]).history(0, 2), np.stack([images[0][2]] * 2, -1)
    )


def test_points_lie_on_the_grid():
    image = np.zeros(LIDAR.shape, bool)
    image[255, 0] = image[0, 100] = image[100, 511] = True
    xyz = polar_to_points(image)
    np.testing.assert_allclose(xyz[0], 0, atol=1e-12)
    np.testing.assert_allclose(xyz[1], [0, 10.8 * 100 / 255, 0], atol=1e-12)
    np.testing.assert_allclose(xyz[2], [0, -10.8, 0], atol=1e-12)


def test_images_and_points_are_inverse():
    occupied = np.random.default_rng(1).random(LIDAR.shape) < 0.02
    occupied[0] = False  # all of row 0 is one point, the sensor
    np.testing.assert_array_equal(points_to_polar(polar_to_points(occupied)), occupied)


def test_a_point_takes_the_first_pixel_that_is_not_below():
    spec = PolarSpec(num_range=11, num_azimuth=3, max_range_m=10.0)
    angle = math.radians(10)  # columns stand for -90, 0 and 90 degrees
    xyz = np.array([[4.2 * math.cos(angle), 4.2 * math.sin(angle), 0.0]])
    assert np.argwhere(points_to_polar(xyz, spec)).tolist() == [[5, 2]]
    outside = np.array([[10.1, 0, 0], [-3.0, 0.1, 0], [0.0, 0, 0]])
    assert not points_to_polar(outside, spec).any()


def test_what_is_missing_or_broken_is_named(folder, packed, tmp_path):
    with pytest.raises(ValueError, match="no test/radar and test/lidar"):
        open_radarhd(folder, split="test")
    with pytest.raises(FileNotFoundError, match="nowhere"):
        open_radarhd(tmp_path / "nowhere")
    torn = tmp_path / "torn.npz"
    torn.write_bytes(packed.read_bytes()[:-50])
    with pytest.raises(ValueError, match="no packed file"):
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
