"""Targets: nearness is exact, and is what its loss compares with."""

import ast
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import KDTree

from jradar import training
from jradar.data import AugmentSpec
from jradar.diffusion import NoiseSpec
from jradar.model.grids.polar import LIDAR
from jradar.training.targets import (
    REACH_M,
    pair_batches,
    polar_nearness,
    voxel_nearness,
)
from tests.data.prepared import invented_frame
from tests.models import SPEC


def walls(seed):
    """An occupancy image with single pixels and a piece of a wall."""
    random = np.random.default_rng(seed)
    occupied = np.zeros(LIDAR.shape, bool)
    occupied[tuple(random.integers(0, size, 40) for size in LIDAR.shape)] = True
    occupied[90, 100:300] = occupied[0, 3] = occupied[255, 511] = True
    return occupied


def test_nearness_is_that_of_a_nearest_neighbour_search():
    pixels = LIDAR.xyz.reshape(-1, 3)
    truth = np.stack([walls(0), walls(1), np.zeros(LIDAR.shape, bool)])
    found = np.asarray(polar_nearness(jnp.asarray(truth[..., None], jnp.float32)))[
        ..., 0
    ]
    for image, near in zip(truth[:2], found[:2], strict=True):
        apart, _ = KDTree(LIDAR.xyz[image]).query(pixels)
        expected = np.maximum(1 - apart / REACH_M, 0).reshape(LIDAR.shape)
        np.testing.assert_allclose(near, expected, atol=1e-5)
    assert not found[2].any()
    with pytest.raises(ValueError, match=r"8 x 8 pixels, expected \(256, 512\)"):
        polar_nearness(jnp.zeros((1, 8, 8, 1)))


def test_pixels_between_far_beams_are_not_learnt():
    frame = invented_frame(0, lidar_points=40)
    grid = SPEC.grid
    batch, known = (
        pair_batches([frame], grid, AugmentSpec(), batch_size=1, seed=0, **reach)(0)
        for reach in ({"reach": 4}, {})
    )
    validity, plain = (np.asarray(b.target)[0, ..., 1] for b in (batch, known))
    assert set(np.unique(plain)) == {-1, 1}
    apart = ndimage.distance_transform_cdt(plain < 0, metric="chessboard")
    near = (plain < 0) & (apart <= 4)
    assert near.any() and not validity[near].any()
    np.testing.assert_array_equal(validity[~near], plain[~near])


def test_nearness_is_one_in_a_voxel_and_falls_by_a_third_with_each_around_it():
    occupied = np.zeros((1, 9, 9, 9), np.float32)
    occupied[0, 4, 4, 0] = 1
    x, y, z = np.indices((9, 9, 9))
    away = np.maximum(np.maximum(abs(x - 4), abs(y - 4)), z)
    found = voxel_nearness(jnp.asarray(occupied))[0]
    np.testing.assert_allclose(found, np.maximum(1 - away / 3, 0), atol=1e-6)


def test_losses_of_nearness_are_of_the_nearness_of_what_is_occupied():
    """An answer that is the nearness costs less than one that is the occupancy."""
    occupied = np.zeros((1, 8, 8, 8), np.float32)
    occupied[0, 4, 4, 4] = 1
    near = np.asarray(voxel_nearness(jnp.asarray(occupied)))
    loss = training.LOSSES["columns"]["nearness"]

    def at(share):
        share = np.clip(share, 1e-3, 1 - 1e-3)
        odds = jnp.asarray(np.log(share / (1 - share)) - np.log(0.03 / 0.97))
        noise = NoiseSpec()
        return float(
            loss(None, lambda x, sigma: odds, jnp.asarray(occupied), noise=noise)
        )

    assert at(near) < at(0.9 * near) < at(occupied)


def test_ordinary_training_does_not_import_fine_tuning():
    folder = Path(training.__file__).parent
    own = {"finetuning", "choosing", "replay"}
    for path in folder.glob("*.py"):
        if path.stem in own:
            continue
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ImportFrom):
                assert node.module.rpartition(".")[2] not in own, path
