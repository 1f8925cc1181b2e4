"""Codec: inverse pairs, monotone, smooth fill, validity decides, condition channels."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.range_code import CODECS
from jradar.range_image import (
    OF_HISTORY,
    ImageSpec,
    close_gaps,
    condition_image,
    decode_range,
    decode_target,
    encode_range,
    encode_target,
)
from jradar.range_image.codec import fill_misses, observed_pixels, pattern_reach
from jradar.types import PointCloud

FILL = jax.jit(fill_misses)
SPEC = ImageSpec(height=12, width=20, max_range_m=10.0)


@pytest.mark.parametrize("codec", CODECS)
def test_range_code_is_monotone_from_minus_1_to_1_and_back(codec):
    view = {"max_range_m": 10.0, "codec": codec}
    metres = np.append(np.linspace(0, 10, 101), 99).astype(np.float32)
    code = np.asarray(encode_range(jnp.asarray(metres), **view))
    assert code[0] == -1 and code[-2:] == pytest.approx(1, abs=1e-6)
    assert (np.diff(code[:-1]) > 0).all()
    back = np.asarray(decode_range(jnp.append(code, 9.0), **view))
    np.testing.assert_allclose(back[:-2], metres[:-1], atol=2e-5)
    assert back[-1] <= 10.0001
    for function in (encode_range, decode_range):
        with pytest.raises(ValueError, match="'cubic', expected one of"):
            function(jnp.zeros(3), max_range_m=10.0, codec="cubic")


@pytest.mark.parametrize("codec", CODECS)
def test_the_range_code_grows_with_the_view(codec):
    near = encode_range(jnp.array([0.5, 3.0, 11.0]), max_range_m=12.0, codec=codec)
    far = encode_range(jnp.array([2.5, 15.0, 55.0]), max_range_m=60.0, codec=codec)
    np.testing.assert_allclose(near, far, rtol=1e-6)


def test_in_a_view_of_12_m_the_logarithmic_code_counts_metres():
    code = encode_range(jnp.array([1.0, 5.0]), max_range_m=12.0)
    wanted = 2 * np.log([2.0, 6.0]) / np.log(13.0) - 1
    np.testing.assert_allclose(code, wanted, rtol=1e-6)


@pytest.mark.parametrize("codec", CODECS)
def test_target_round_trip_keeps_hits_and_misses(codec):
    image = np.random.default_rng(0).uniform(0, 10, (2, *SPEC.shape))
    image = np.where(image > 6, 0, image).astype(np.float32)
    target = encode_target(image, SPEC, codec=codec)
    assert target.shape == (2, 12, 20, 2)
    back = np.asarray(decode_target(target, SPEC, codec=codec))
    np.testing.assert_array_equal(back > 0, image > 0)
    np.testing.assert_allclose(back, image, atol=2e-5)


def test_filling_keeps_hits_and_stays_within_their_range():
    rng = np.random.default_rng(0)
    value, hit = rng.random(SPEC.shape, np.float32), rng.random(SPEC.shape) < 0.2
    filled = np.asarray(FILL(value, hit))
    np.testing.assert_allclose(filled[hit], value[hit], rtol=1e-6)
    assert filled.min() >= value[hit].min() - 1e-6
    assert filled.max() <= value[hit].max() + 1e-6
    np.testing.assert_allclose(FILL(np.ones_like(value), hit), 1, rtol=1e-6)
    assert not FILL(value, np.zeros_like(hit)).any()  # finite


def test_condition_holds_presence_place_and_power():
    spec = ImageSpec(height=4, width=8, max_range_m=8.0)
    xyz = jnp.array([[1.0, 0.01, 0.01], [7.5, 0.01, 0.01]])
    cloud = PointCloud(xyz, jnp.ones(2, bool), power=jnp.array([1e6, 1e3]))
    image = np.asarray(condition_image(cloud, spec, num_slices=4))
    assert image.shape == (4, 8, 12)
    presence, offset, power = np.split(image[1, 4], 3)
    assert presence.tolist() == [1, 0, 0, 1]
    np.testing.assert_allclose(offset, [0, 0, 0, 0.5], atol=1e-3)
    np.testing.assert_allclose(power, [1, 0, 0, 0.5], atol=1e-5)
    assert presence.sum() == image[..., :4].sum()
    nothing = cloud._replace(valid=jnp.zeros(2, bool))
    assert not condition_image(nothing, spec, num_slices=4).any()
    with pytest.raises(ValueError, match="num_slices=0, expected 1 or more"):
        condition_image(cloud, spec, num_slices=0)


def test_points_of_several_frames_have_the_least_age_and_their_count():
    xyz = jnp.asarray([[3.0, 0.01, 0.01], [3.1, 0.01, 0.01], [9.0, 0.01, 0.01]])
    cloud = PointCloud(xyz, jnp.ones(3, bool), age=jnp.asarray([1.0, 0.5, 4.0]))
    spec = ImageSpec(8, 8, max_range_m=12.0)
    found = condition_image(cloud, spec, num_slices=2, channels=OF_HISTORY)
    np.testing.assert_array_equal(
        found[..., :6], condition_image(cloud, spec, num_slices=2)
    )
    pixel = tuple(np.argwhere(np.asarray(found[..., 0]))[0])
    np.testing.assert_allclose(found[pixel][6:8], [0.25, 1.0])  # 0.5 s of 2, and 4
    np.testing.assert_allclose(found[pixel][8:], [np.log(2) / np.log(64), 0.0])
    assert np.count_nonzero(found[..., 6:]) == 3


def test_a_wall_seen_by_few_beams_is_closed_and_no_wider():
    wall = 4 + 0.03 * np.arange(16)[:, None] + 0.02 * np.arange(24)
    seen = np.zeros((16, 24), np.float32)
    seen[2:14:2, 3:20:2] = wall[2:14:2, 3:20:2]  # every other row and column
    seen[6, 9] = 0  # and a beam that did not return: no neighbour is 2 pixels away
    closed = np.asarray(close_gaps(seen, reach=2))
    inside = np.zeros(seen.shape, bool)
    inside[2:13, 3:20] = True
    np.testing.assert_array_equal(closed > 0, inside & (closed > 0))
    missing = np.argwhere(inside & (closed == 0)).tolist()  # it and its neighbours
    assert missing == [[5, 9], [6, 8], [6, 9], [6, 10], [7, 9]]
    np.testing.assert_allclose(closed[closed > 0], wall[closed > 0], rtol=1e-6)
    np.testing.assert_array_equal(close_gaps(closed)[seen > 0], seen[seen > 0])
    np.testing.assert_array_equal(close_gaps(seen, reach=0), seen)
    both = np.stack([seen, np.zeros_like(seen)])
    np.testing.assert_array_equal(close_gaps(both), [closed, np.zeros_like(seen)])
    row = np.float32([[0, 2, 0, 6, 0, 0, 6.1, 0, 0, 0, 6]])  # two surfaces
    expected = [[0, 2, 2, 6, 6 + 0.1 / 3, 6 + 0.2 / 3, 6.1, 0, 0, 0, 6]]
    np.testing.assert_allclose(close_gaps(row), expected, rtol=1e-6)


def test_gradients_of_points_without_power_are_finite():
    cloud = PointCloud.from_xyz(jnp.array([[3.0, 0, 0], [4.0, 1, 0.5]]))

    @jax.jit
    def slopes(xyz, power):
        def total(xyz, power):
            these = cloud._replace(xyz=xyz, power=power)
            image = condition_image(these, SPEC, num_slices=2)
            return (image * jnp.arange(image.size).reshape(image.shape)).sum()

        return jax.grad(total, (0, 1))(xyz, power)

    for powers in ([0.0, 0.0], [0.0, 2.0], [1e-25, 1.0]):
        for part in slopes(cloud.xyz, jnp.array(powers)):
            assert np.isfinite(part).all()


def test_hits_and_misses_away_from_them_are_observed():
    image = np.zeros((8, 9), np.float32)
    image[2, 3] = 5.0
    observed = np.asarray(observed_pixels(image, reach=2))
    assert observed[2, 3]
    assert not observed[2, 4]
    assert not observed[4, 5]
    assert observed[2, 6]
    assert observed[5, 3]
    assert observed_pixels(image, reach=0).all()


@pytest.mark.parametrize(("pitch", "reach"), [(1, 0), (2, 1), (7, 3), (17, 8)])
def test_the_reach_of_a_pattern_is_half_its_holes(pitch, reach):
    wall = np.zeros((2, 96, 128), np.float32)
    wall[:, ::pitch], wall[:, :, ::pitch] = 3.0, 3.0
    wall[:, 70:, 70:] = 0.0  # open space has no pattern
    assert pattern_reach(wall) == reach


def test_a_frame_without_a_hit_has_no_pattern():
    assert pattern_reach(np.zeros((3, 8, 8), np.float32)) == 0


def test_gaps_are_closed_where_misses_are_unknown():
    image = np.full((1, 5), -1.0, np.float32)
    image[0, [0, 2]] = 4.0
    np.testing.assert_array_equal(close_gaps(image, reach=2), [[4, 4, 4, -1, -1]])
