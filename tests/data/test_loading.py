"""Loading: pairs of images, and batches as a pure function of seed and step."""

import jax
import numpy as np
import pytest

from jradar.data.loading import Batches, PairSource, joined, lidar_image
from jradar.range_image import ImageSpec, condition_image, project
from jradar.types import PointCloud
from tests.data.prepared import invented_frame

VIEW = {"azimuth": (-1.0, 1.0), "elevation": (-0.4, 0.4), "max_range_m": 10.0}
COARSE, FINE = ImageSpec(16, 16, **VIEW), ImageSpec(32, 64, **VIEW)


@pytest.fixture(scope="module")
def pairs():
    frames = [invented_frame(i, lidar_points=200 * i) for i in range(10)]
    return PairSource(frames, COARSE, FINE, num_slices=2)


def test_images_equal_the_kernels(pairs):
    frame = invented_frame(7, lidar_points=1400)
    condition = condition_image(frame.radar, COARSE, num_slices=2)
    np.testing.assert_array_equal(pairs[7].condition, condition)
    cloud = PointCloud.from_xyz(frame.lidar_xyz)
    np.testing.assert_array_equal(pairs[7].lidar, project(cloud, FINE))
    assert pairs[7].lidar.any() and not pairs[0].lidar.any()


@pytest.mark.parametrize("count", [0, 1, 1024, 1025])
def test_clouds_of_any_size_have_an_image(count):
    xyz = np.tile(np.array([[5.0, 0.0, 0.0]], np.float32), (count, 1))
    assert np.count_nonzero(lidar_image(xyz, FINE)) == min(count, 1)


def numbers(batches, steps):
    return [np.ravel(batches[i]).tolist() for i in steps]


def test_a_batch_depends_on_seed_and_step_only():
    one = Batches(range(10), seed=3, batch_size=4)
    other = Batches(range(10), seed=3, batch_size=4)
    steps = [5, 0, 17, 5, 6]
    assert numbers(one, steps) == [*map(numbers(other, range(18)).__getitem__, steps)]
    different = Batches(range(10), seed=4, batch_size=4)
    assert numbers(one, range(5)) != numbers(different, range(5))


def test_every_epoch_holds_every_item_once_in_another_order():
    batches = Batches(range(12), seed=0, batch_size=4)
    epochs = [sum(numbers(batches, range(3 * e, 3 * e + 3)), []) for e in range(3)]
    assert all(sorted(epoch) == [*range(12)] for epoch in epochs)
    assert epochs[0] != epochs[1] != epochs[2]


def test_pairs_are_stacked_leaf_by_leaf(pairs):
    batch = Batches(pairs, seed=0, batch_size=3)[2]
    assert batch.condition.shape == (3, 16, 16, 6) and batch.lidar.shape == (3, 32, 64)
    known = {pair.lidar.tobytes() for pair in pairs[:]}
    assert all(image.tobytes() in known for image in batch.lidar)
    assert jax.tree.structure(batch).num_leaves == 2


def test_a_damaged_item_is_an_error_of_its_batch_and_no_items_are_refused():
    class Damaged(list):
        def __getitem__(self, index):
            raise ValueError("frame 3 is damaged")

    batches = Batches(Damaged([1, 2]), seed=0, batch_size=1)
    with pytest.raises(ValueError, match="frame 3 is damaged"):
        batches[0]
    with pytest.raises(ValueError, match="no frames"):
        Batches([], seed=0, batch_size=1)


def test_sources_are_joined_one_after_another():
    found = joined("ab", "", "cde")
    assert len(found) == 5 and "".join(found) == "abcde"
    assert found[-1] == "e" and len(joined()) == 0
