"""Agreement equals a count by hand and does not depend on the order of draws."""

import jax
import numpy as np
import pytest

from jradar.range_image import RangeImage, agreed_range, confident


def by_hand(ranges, share, tolerance_m):
    """The same for one pixel, in plain Python."""
    hits = [r for r in ranges if r > 0]
    groups = [[s for s in hits if abs(s - r) <= tolerance_m] for r in hits]
    most = max((len(group) for group in groups), default=0)
    if most == 0 or most < share * len(ranges):
        return 0.0
    return min(np.mean(group) for group in groups if len(group) == most)


@pytest.mark.parametrize("share", [0.375, 1.0])
def test_it_equals_a_count_by_hand_in_any_order(share):
    rng = np.random.default_rng(0)
    surfaces = rng.choice([0.0, 2.0, 2.3, 5.0], size=(8, 6, 7))
    images = np.where(surfaces > 0, surfaces + rng.uniform(0, 0.15, (8, 6, 7)), 0)
    images = images.astype(np.float32)
    agreed = np.asarray(confident(agreed_range(images), share).range_m)
    pixels = images.reshape(8, -1).T.astype(float)
    expected = [by_hand(pixel, share, 0.2) for pixel in pixels]
    np.testing.assert_allclose(agreed.ravel(), expected, rtol=1e-5)
    if share < 0.5:
        assert 0 < np.count_nonzero(agreed)
    shuffled = confident(agreed_range(images[rng.permutation(8)]), share).range_m
    np.testing.assert_allclose(shuffled, agreed, rtol=1e-6)


def test_no_point_hangs_between_two_surfaces():
    images = np.full((8, 1, 3), 2.0, np.float32)
    images[:5, 0, 1] = 6.0  # five of eight behind, three in front
    images[:, 0, 2] = [0, 0, 0, 0, 0, 0, 4, 4.1]  # two are too few
    image = agreed_range(images)
    np.testing.assert_allclose(image.confidence, [[1.0, 0.625, 0.25]])
    kept = confident(image, 0.375)
    np.testing.assert_allclose(kept.range_m, [[2.0, 6.0, 0.0]], rtol=1e-6)
    np.testing.assert_allclose(kept.confidence, [[1.0, 0.625, 0.0]])


def test_an_image_without_confidence_is_kept_whole():
    image = RangeImage(np.full((2, 3), 4.0, np.float32))
    assert confident(image, 0.9) is image or (confident(image, 0.9).range_m == 4).all()


def test_vmap_over_frames_equals_the_loop():
    frames = np.random.default_rng(1).uniform(0, 1, (2, 8, 6, 7)).astype(np.float32)
    batch = jax.vmap(agreed_range)(frames)
    for found, frame in zip(batch.range_m, frames, strict=True):
        np.testing.assert_allclose(found, agreed_range(frame).range_m, rtol=1e-6)


def test_wrong_options_are_refused():
    with pytest.raises(ValueError, match=r"tolerance_m=0\.0, expected more than 0 met"):
        agreed_range(np.ones((2, 3, 4), np.float32), tolerance_m=0.0)
