"""Evidence: pixels near an echo, points that gather, and what lies around them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.range_image import (
    ImageSpec,
    crowding,
    near_echo,
    surroundings,
    unproject,
)
from jradar.types import PointCloud

SPEC = ImageSpec(8, 16, azimuth=(-1.0, 1.0), elevation=(-0.4, 0.4), max_range_m=12.0)
RANDOM = np.random.default_rng(0)
RANGES = RANDOM.uniform(0.5, 12.0, (3, 8, 16)).astype(np.float32)
RANGES[:, 0, :4] = 0.0
IMAGES = [unproject(jnp.asarray(image), SPEC) for image in RANGES]
SEEN = np.asarray(IMAGES[0].xyz)
# Some close to what the image shows, others anywhere, also beyond the view.
POINTS = np.concatenate(
    [SEEN[::9] + RANDOM.normal(0, 0.4, SEEN[::9].shape), [[30, 0, 0]]]
)
CLOUD = PointCloud(jnp.asarray(POINTS, jnp.float32), jnp.arange(len(POINTS)) % 5 > 0)


def test_near_is_half_a_metre_along_each_axis():
    near = np.asarray(near_echo(IMAGES[0], CLOUD, SPEC))
    known = POINTS[np.asarray(CLOUD.valid)]
    away = np.abs(SEEN[:, None] - known).max(-1).min(1)
    shown = RANGES[0].ravel() > 0
    assert near[shown & (away <= 0.5)].all() and (shown & (away <= 0.5)).any()
    assert not near[away > 0.75].any() and not near[~shown].any()


def test_only_echoes_of_6_db_stand_out():
    quiet = CLOUD._replace(snr=jnp.full(len(POINTS), 3.9))
    assert not near_echo(IMAGES[0], quiet, SPEC).any()
    loud = CLOUD._replace(snr=jnp.full(len(POINTS), 4.1))
    same = near_echo(IMAGES[0], CLOUD, SPEC)
    np.testing.assert_array_equal(near_echo(IMAGES[0], loud, SPEC), same)


def test_a_point_that_is_not_valid_is_near_nothing():
    place = jnp.array([[4.0, 1.0, 0.0], [4.0, 1.0, 0.0]])
    cloud = PointCloud(place, jnp.array([True, False]))
    np.testing.assert_array_equal(
        near_echo(cloud, PointCloud.from_xyz(place), SPEC), [True, False]
    )


def test_images_together_are_images_one_by_one():
    stacked = jax.tree.map(lambda *values: jnp.stack(values), *IMAGES)
    both = jax.vmap(near_echo, (0, None, None))(stacked, CLOUD, SPEC)
    one_by_one = [near_echo(image, CLOUD, SPEC) for image in IMAGES]
    np.testing.assert_array_equal(both, one_by_one)


def test_crowding_grows_with_the_points_near():
    away = np.array([[5.0, 0.0, 0.0], [2.0, 2.0, 0.5], [8.0, -3.0, 0.0]])
    counts = (1, 32, 1024)
    xyz = np.repeat(away, counts, 0)
    found = crowding(PointCloud.from_xyz(xyz), SPEC)
    np.testing.assert_allclose(found, np.repeat([0.0, 0.5, 1.0], counts), atol=1e-6)
    lone = PointCloud.from_xyz(xyz)._replace(valid=jnp.arange(len(xyz)) < 2)
    np.testing.assert_array_equal(crowding(lone, SPEC), 0.0)


def test_points_above_each_other_gather_in_the_plane_alone():
    xyz = np.array([[5.0, 1.0, z] for z in np.linspace(-3, 3, 32)])
    tower = PointCloud.from_xyz(xyz)
    np.testing.assert_allclose(crowding(tower, SPEC, axes=2), 0.5, atol=1e-6)
    assert (np.asarray(crowding(tower, SPEC)) < 0.4).all()
    flat = PointCloud(tower.xyz * jnp.asarray((1.0, 1.0, 0.0)), tower.valid)
    np.testing.assert_array_equal(crowding(flat, SPEC), crowding(flat, SPEC, axes=2))


def test_what_is_around_a_point_faces_the_radar():
    xyz = np.array([[6.0, 0.0, 0.0], [3.0, 3.0, 0.4], [20.0, 0.0, 0.0], [5.0, 0.0, 0]])
    points = PointCloud(
        jnp.asarray(xyz, jnp.float32),
        jnp.asarray([True, True, True, False]),
        velocity=jnp.asarray([1.0, 2.0, 3.0, 4.0]),
        confidence=jnp.asarray([0.1, 0.2, 0.3, 0.4]),
    )
    found = surroundings(points, SPEC)
    count = len(found.valid) // len(xyz)
    valid = np.asarray(found.valid).reshape(4, count)
    assert valid[:2].all() and not valid[2:].any()  # out of view, and padding
    around = np.asarray(found.xyz).reshape(4, count, 3)
    for k, centre in enumerate(xyz[:2]):
        ahead = centre / np.linalg.norm(centre)
        depth = (around[k] - centre) @ ahead
        across = np.linalg.norm(around[k] - centre - depth[:, None] * ahead, axis=1)
        np.testing.assert_allclose(np.abs(depth), 0.1, atol=1e-5)
        # A Gaussian of deviation 0.3 m along two axes: the median is 0.35 m.
        assert np.median(across) == pytest.approx(
            0.3 * np.sqrt(2 * np.log(2)), abs=0.02
        )
        middle = around[k].mean(0)
        assert np.linalg.norm(middle - centre) < 0.1
    for name, values in (("velocity", [1.0, 2.0]), ("confidence", [0.1, 0.2])):
        each = np.asarray(getattr(found, name)).reshape(4, count)
        np.testing.assert_allclose(each[:2], np.repeat(values, count).reshape(2, count))
    assert not np.asarray(found.confidence)[~np.asarray(found.valid)].any()


def test_nothing_around_a_point_lies_outside_the_view():
    corner = np.array([[11.9, 0.0, 0.0], [3.0, 3.0 * np.tan(0.99), 0.0]])
    found = surroundings(PointCloud.from_xyz(corner), SPEC)
    valid = np.asarray(found.valid).reshape(2, -1)
    assert valid.any(1).all() and not valid.all(1).any()
    x, y, _ = np.asarray(found.xyz)[valid.ravel()].T
    assert np.abs(np.arctan2(y, x)).max() <= 1.0
    assert np.linalg.norm(np.asarray(found.xyz)[valid.ravel()], axis=1).max() <= 12.0


def test_gradients_around_padding_are_finite():
    padded = PointCloud(jnp.zeros((3, 3)).at[0, 0].set(4.0), jnp.arange(3) < 1)
    slope = jax.grad(lambda p: surroundings(p, SPEC).xyz.sum(), allow_int=True)(padded)
    assert np.isfinite(slope.xyz).all() and np.asarray(slope.xyz)[0].any()


def test_a_point_at_the_origin_or_overhead_has_no_surroundings_and_finite_gradients():
    xyz = jnp.array([[4.0, 0, 0], [0, 0, 0], [0, 0, 2], [1e-20, 0, 9]])
    points = PointCloud(xyz, jnp.ones(4, bool))
    around = surroundings(points, SPEC).valid.reshape(4, -1)
    assert around.any(1).tolist() == [True, False, False, False]
    slope = jax.grad(lambda p: surroundings(p, SPEC).xyz.sum(), allow_int=True)(points)
    assert np.isfinite(slope.xyz).all() and np.asarray(slope.xyz)[0].any()


def test_places_beyond_the_largest_range_are_near_nothing():
    far, edge = (PointCloud.from_xyz([[x, 0.0, 0.0]]) for x in (20.0, 12.2))
    assert near_echo(edge, edge, SPEC).all() and not near_echo(far, edge, SPEC).any()
