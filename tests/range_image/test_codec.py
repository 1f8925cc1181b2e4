"""Codec: inverse pairs, monotone, smooth fill, validity decides, condition channels."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.range_image import (
    ImageSpec,
    close_gaps,
    condition_image,
    decode_range,
    decode_target,
    encode_range,
    encode_target,
)
from jradar.range_image.codec import CODECS, fill_misses
from jradar.types import PointCloud

FILL = jax.jit(fill_misses)
SPEC = ImageSpec(height=12, width=20, max_range_m=10.0)


@pytest.mark.parametrize("codec", CODECS)
def test_range_code_is_monotone_from_minus_1_to_1_and_back(codec):
    metres = jnp.linspace(0, 10, 101)
    code = encode_range(metres, max_range_m=10.0, codec=codec)
    assert code[0] == -1 and code[-1] == pytest.approx(1, abs=1e-6)
    assert (jnp.diff(code) > 0).all()
    back = decode_range(code, max_range_m=10.0, codec=codec)
    np.testing.assert_allclose(back, metres, atol=2e-5)
    assert encode_range(jnp.array(99.0), max_range_m=10.0, codec=codec) <= 1 + 1e-6
    assert decode_range(jnp.array(9.0), max_range_m=10.0, codec=codec) <= 10.0001


def test_an_image_without_slices_is_refused():
    with pytest.raises(ValueError, match="num_slices=0, expected 1 or more"):
        condition_image(PointCloud.from_xyz(jnp.ones((1, 3))), SPEC, num_slices=0)


def test_unknown_codec_is_named():
    for function in (encode_range, decode_range):
        with pytest.raises(ValueError, match="'cubic', expected one of"):
            function(jnp.zeros(3), max_range_m=10.0, codec="cubic")


@pytest.mark.parametrize("codec", CODECS)
def test_target_round_trip_keeps_hits_and_misses(codec):
    image = jax.random.uniform(jax.random.key(0), (2, *SPEC.shape), maxval=10.0)
    image = jnp.where(image > 6, 0.0, image)
    target = encode_target(image, SPEC, codec=codec)
    assert target.shape == (2, 12, 20, 2)
    back = decode_target(target, SPEC, codec=codec)
    np.testing.assert_array_equal(back > 0, image > 0)
    np.testing.assert_allclose(back, image, atol=2e-5)


def test_filling_keeps_hits_and_stays_within_their_range():
    value = jax.random.uniform(jax.random.key(0), SPEC.shape)
    hit = jax.random.bernoulli(jax.random.key(1), 0.2, SPEC.shape)
    filled = FILL(value, hit)
    np.testing.assert_allclose(filled[hit], value[hit], rtol=1e-6)
    assert filled.min() >= value[hit].min() - 1e-6
    assert filled.max() <= value[hit].max() + 1e-6
    np.testing.assert_allclose(FILL(jnp.ones(SPEC.shape), hit), 1, rtol=1e-6)


def test_filling_an_empty_image_is_finite():
    assert not FILL(jnp.ones(SPEC.shape), jnp.zeros(SPEC.shape, bool)).any()


def test_condition_holds_presence_place_and_power():
    spec = ImageSpec(height=4, width=8, max_range_m=8.0)
    xyz = jnp.array([[1.0, 0.01, 0.01], [7.5, 0.01, 0.01]])
    cloud = PointCloud(xyz, jnp.ones(2, bool), power=jnp.array([1e6, 1e3]))
    image = condition_image(cloud, spec, num_slices=4)
    assert image.shape == (4, 8, 12)
    presence, offset, power = jnp.split(image[1, 4], 3)
    assert presence.tolist() == [1, 0, 0, 1]
    np.testing.assert_allclose(offset, [0, 0, 0, 0.5], atol=1e-3)
    np.testing.assert_allclose(power, [1, 0, 0, 0.5], atol=1e-5)
    assert presence.sum() == image[..., :4].sum()


def test_condition_of_an_empty_cloud_is_zero():
    cloud = PointCloud.from_xyz(np.zeros((5, 3), np.float32))
    assert not condition_image(cloud, SPEC, num_slices=4).any()


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
    both = jnp.stack([seen, jnp.zeros_like(seen)])
    np.testing.assert_array_equal(close_gaps(both), [closed, np.zeros_like(seen)])


def test_between_two_surfaces_the_nearer_one_hides_the_other():
    row = np.float32([[0, 2, 0, 6, 0, 0, 6.1, 0, 0, 0, 6]])
    expected = [[0, 2, 2, 6, 6 + 0.1 / 3, 6 + 0.2 / 3, 6.1, 0, 0, 0, 6]]
    np.testing.assert_allclose(close_gaps(row), expected, rtol=1e-6)


@pytest.mark.parametrize("powers", [[0.0, 0.0], [0.0, 2.0], [1e-25, 1.0]])
def test_gradients_of_points_without_power_are_finite(powers):
    cloud = PointCloud.from_xyz(jnp.array([[3.0, 0, 0], [4.0, 1, 0.5]]))

    def total(xyz, power):
        image = condition_image(
            cloud._replace(xyz=xyz, power=power), SPEC, num_slices=2
        )
        return (image * jnp.arange(image.size).reshape(image.shape)).sum()

    for part in jax.grad(total, (0, 1))(cloud.xyz, jnp.array(powers)):
        assert jnp.isfinite(part).all()
