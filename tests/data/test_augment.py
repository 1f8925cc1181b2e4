"""Changes of frames in training: images change as the place would."""

import numpy as np
import pytest

from jradar.data import AugmentedPairs, AugmentSpec, Batches
from jradar.data.augment import alone, augmented, moved, with_true_points
from jradar.data.loading import make_pair
from jradar.range_image import ImageSpec, encode_target
from tests.data.prepared import invented_frame

VIEW = {"azimuth": (-1.0, 1.0), "elevation": (-0.4, 0.4), "max_range_m": 10.0}
COARSE, FINE = ImageSpec(16, 16, **VIEW), ImageSpec(32, 64, **VIEW)
FRAME = invented_frame(3, lidar_points=3000)


def random(seed=0):
    return np.random.default_rng(seed)


def pair_of(frame):
    return make_pair(frame, COARSE, FINE, num_slices=2)


def drawn(seed=0, **augment):
    """A pair of FRAME, changed."""
    change = AugmentedPairs(COARSE, FINE, 2, AugmentSpec(**augment))
    return change(FRAME, random(seed))


def test_nothing_changes_by_default():
    for image, expected in zip(drawn(), pair_of(FRAME), strict=True):
        np.testing.assert_array_equal(image, expected)


def test_a_mirrored_frame_gives_the_mirrored_images():
    plain, flipped = pair_of(FRAME), pair_of(moved(FRAME, np.diag([1.0, -1.0, 1.0])))
    for image, expected in zip(flipped, plain, strict=True):
        np.testing.assert_allclose(image[:, ::-1], expected, atol=1e-5)
    found = [drawn(seed, mirror=True).lidar for seed in range(20)]
    turned = [not np.array_equal(image, plain.lidar) for image in found]
    assert 3 < sum(turned) < 17


def test_a_rotated_frame_moves_along_the_columns_and_leaves_the_unknown():
    plain, found = pair_of(FRAME).lidar, drawn(rotation=0.5).lidar
    _, unknown = augmented(FRAME, random(), AugmentSpec(rotation=0.5))
    columns = round(unknown.rotated * 32)
    assert abs(columns) > 3
    hidden = (found == -1).all(0)
    assert hidden.sum() == abs(columns) and not (found[:, ~hidden] == -1).any()
    assert hidden[0] == (columns > 0)  # what is to the right of the old view
    known = np.roll(plain, columns, 1)[:, ~hidden] > 0
    same = ((found[:, ~hidden] > 0) == known).mean()
    assert same > 0.8 > ((found[:, ~hidden] > 0) == (plain > 0)[:, ~hidden]).mean()


@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_a_scaled_frame_has_scaled_ranges_and_unknown_misses_if_smaller(factor):
    plain = pair_of(FRAME)
    found = drawn(scale=(factor, factor))
    seen = (plain.lidar > 0) & (plain.lidar * factor < 10)
    np.testing.assert_allclose(found.lidar[seen], factor * plain.lidar[seen], rtol=1e-5)
    misses = found.lidar[plain.lidar == 0]
    assert (misses == (-1 if factor < 1 else 0)).all()
    validity = np.asarray(encode_target(found.lidar, FINE))[..., 1]
    np.testing.assert_array_equal(validity[plain.lidar == 0], 0 if factor < 1 else -1)


def test_points_are_left_out_at_random():
    thinned = (augmented(FRAME, random(n), AugmentSpec(thin=0.5)) for n in range(50))
    kept = [np.sum(frame[0].radar.valid) for frame in thinned]
    before = np.sum(FRAME.radar.valid)
    assert 0.65 * before < np.mean(kept) < 0.85 * before and max(kept) > 0.9 * before


def test_one_object_is_left_alone():
    found = alone(FRAME, random())
    assert 0 < len(found.lidar_xyz) < 0.7 * len(FRAME.lidar_xyz)
    same = (found.radar.xyz == FRAME.radar.xyz).all(1) & FRAME.radar.valid
    points = np.concatenate([found.lidar_xyz, found.radar.xyz[same]])
    assert same.any() and np.ptp(points[:, :2], axis=0).max() < 3.0
    louder = found.radar.power[same] / FRAME.radar.power[same]
    np.testing.assert_allclose(louder, louder[0], rtol=1e-5)
    noise = found.radar.power[~same]
    floor = np.quantile(FRAME.radar.power[FRAME.radar.valid], 0.05)
    assert noise.min() == pytest.approx(floor, rel=1e-2)
    assert np.median(noise) < 2 * floor
    assert found.radar.power[same].max() > 10**1.5 * floor
    np.testing.assert_array_equal(found.radar.valid, FRAME.radar.valid)


def test_noise_around_a_lone_echo_lies_as_far_away():
    shares, apart = [], []
    for seed in range(60):
        found = alone(FRAME, random(seed))
        same = (found.radar.xyz == FRAME.radar.xyz).all(1) & FRAME.radar.valid
        if same.any():
            ranges = np.linalg.norm(found.radar.xyz, axis=1)
            echo = ranges[same][np.argmax(found.radar.power[same])]
            ridge = ~same & (np.abs(ranges - echo) < 1e-3)
            shares.append(np.sum(ridge) / np.sum(~same))
            sine = found.radar.xyz[:, 1] / np.hypot(*found.radar.xyz[:, :2].T)
            echoes = same & (ranges == echo)
            apart += [*np.abs(sine[ridge] - sine[echoes][0])]
    assert 0.3 < np.mean(np.array(shares) > 0.02) < 0.7
    assert 0.2 < max(shares) < 0.5
    assert 0.08 < np.median(apart) < 0.2  # of a Laplace distribution: 0.14


def test_true_points_replace_the_radars_one_by_one():
    found = with_true_points(FRAME, random())
    valid = np.asarray(found.radar.valid)
    np.testing.assert_array_equal(valid, FRAME.radar.valid)
    chosen = {tuple(point) for point in found.radar.xyz[valid].tolist()}
    assert len(chosen) == valid.sum()
    assert chosen < {tuple(point) for point in FRAME.lidar_xyz.tolist()}
    np.testing.assert_array_equal(found.radar.power, FRAME.radar.power)
    few = with_true_points(FRAME._replace(lidar_xyz=FRAME.lidar_xyz[:5]), random())
    assert np.sum(few.radar.valid) == 5


def test_a_frame_without_lidar_points_changes_too():
    empty = FRAME._replace(lidar_xyz=FRAME.lidar_xyz[:0])
    spec = AugmentSpec(True, 0.5, (0.5, 2.0), 0.3, 1.0, 1.0)
    found, _ = augmented(empty, random(), spec)
    assert not np.any(found.radar.valid)  # no true points


def test_batches_of_changed_frames_depend_on_the_seed():
    change = AugmentedPairs(COARSE, FINE, 2, AugmentSpec(True, 0.3, (0.7, 1.5), 0.3))
    frames = [invented_frame(i) for i in range(6)]

    def batch():
        return Batches(frames, seed=1, batch_size=4, change=change)[3]

    one, other = batch(), batch()
    assert one.condition.shape == (4, 16, 16, 6)
    np.testing.assert_array_equal(one.lidar, other.lidar)


@pytest.mark.parametrize(
    "wrong, words",
    [
        ({"thin": 1.5}, "thin = 1.5"),
        ({"alone": -1.0}, "alone = -1.0"),
        ({"perfect": 2.0}, "perfect = 2.0"),
        ({"scale": (2.0, 1.0)}, "scale = "),
        ({"rotation": -0.1}, "rotation = -0.1"),
    ],
)
def test_impossible_changes_are_refused(wrong, words):
    with pytest.raises(ValueError, match=words):
        AugmentSpec(**wrong)
