"""Pairs: frame i depends on key and i only; batches are a function of the step."""

import jax
import numpy as np
import pytest

from jradar.data import batch_indices, make_pairs
from jradar.radar import RadarSpec
from jradar.range_image import ImageSpec

OPTIONS = {
    "radar": RadarSpec.awr1843(num_chirps=32, num_samples=64),
    "coarse": ImageSpec(8, 8),
    "fine": ImageSpec(16, 32),
    "num_slices": 4,
    "points": {"capacity": 64, "false_alarm_rate": 1.0},
    "baseline": {"capacity": 32},
}


def test_frame_does_not_depend_on_how_many_there_are():
    few = make_pairs(jax.random.key(0), 2, **OPTIONS)
    more = make_pairs(jax.random.key(0), 3, **OPTIONS)
    assert few.condition.shape == (2, 8, 8, 12) and few.lidar.shape == (2, 16, 32)
    assert few.radar.xyz.shape == (2, 32, 3)
    for a, b in zip(jax.tree.leaves(few), jax.tree.leaves(more), strict=True):
        np.testing.assert_array_equal(a, b[:2])
    assert not np.array_equal(few.lidar[0], few.lidar[1])


def test_every_epoch_shows_each_frame_once_in_another_order():
    def epoch(first):
        options = {"batch_size": 4, "num_frames": 12}
        steps = [batch_indices(0, first + i, **options) for i in range(3)]
        return np.concatenate(steps)

    assert sorted(epoch(0)) == sorted(epoch(3)) == [*range(12)]
    assert epoch(0).tolist() != epoch(3).tolist()
    assert epoch(0).tolist() == epoch(0).tolist()


def test_other_seeds_give_other_orders():
    options = {"batch_size": 8, "num_frames": 64}
    assert (batch_indices(0, 5, **options) != batch_indices(1, 5, **options)).any()


def test_batch_larger_than_the_set_is_refused():
    with pytest.raises(ValueError, match="batch_size=8 is more than the 5 frames"):
        batch_indices(0, 0, batch_size=8, num_frames=5)
