"""Projection: Eq. 7 by hand, nearest wins, nothing wraps, slices, and the way back."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from jradar.range_image import (
    ImageSpec,
    RangeImage,
    condition_image,
    image_cloud,
    pixel_of,
    project,
    unproject,
)
from jradar.range_image.projection import project_slices
from jradar.types import PointCloud
from tests.directions import unit

SPEC = ImageSpec(height=8, width=16, max_range_m=10.0)
FINE = ImageSpec(height=128, width=512, max_range_m=12.0)
SPHERE = {"azimuth": (-math.pi, math.pi), "elevation": (-math.pi / 2, math.pi / 2)}
ALL_AROUND = ImageSpec(height=8, width=16, max_range_m=10.0, **SPHERE)


def equation_7(xyz, spec):
    """Row, column (with their fractions) and range of points, in float64."""
    x, y, z = xyz.astype(np.float64).T
    distance = np.linalg.norm(xyz.astype(np.float64), axis=1)
    row = np.arccos(z / distance) - (math.pi / 2 - spec.elevation[1])
    column = np.arctan2(y, x) - spec.azimuth[0]
    down = row * spec.height / np.ptp(spec.elevation)
    return down, column * spec.width / np.ptp(spec.azimuth), distance


def cloud(*points):
    return PointCloud.from_xyz(jnp.asarray(points, jnp.float32).reshape(-1, 3))


@pytest.mark.parametrize("spec", [SPEC, FINE, ALL_AROUND], ids=["8x16", "fine", "all"])
def test_pixel_is_equation_7_in_float64(spec):
    rng = np.random.default_rng(0)
    azimuth = rng.uniform(*spec.azimuth, 100_000)
    elevation = rng.uniform(*spec.elevation, 100_000)
    xyz = unit(azimuth, elevation) * rng.uniform(0.1, 9, (100_000, 1))
    xyz = xyz.astype(np.float32)
    row, column, distance, inside = map(np.asarray, pixel_of(jnp.asarray(xyz), spec))
    expected_row, expected_column, expected_distance = equation_7(xyz, spec)
    clear = (expected_row % 1 > 1e-4) & (expected_row % 1 < 1 - 1e-4)
    clear &= (expected_column % 1 > 1e-4) & (expected_column % 1 < 1 - 1e-4)
    assert clear.mean() > 0.99 and inside[clear].all()
    np.testing.assert_array_equal(column[clear], np.floor(expected_column)[clear])
    np.testing.assert_array_equal(row[clear], np.floor(expected_row)[clear])
    np.testing.assert_allclose(distance, expected_distance, rtol=1e-6)


@pytest.mark.parametrize(
    ("point", "pixel"),
    [
        *(((1, 0, 0), (4, 8)), ((0, 1, 0), (4, 12)), ((0, -1, 0), (4, 4))),
        *(((-1, -1e-6, 0), (4, 0)), ((1, 1, 0), (4, 10))),
        ((0, 0, 1), (0, 8)),  # straight up, where no azimuth is defined
        *(((1e-18, 1e-18, 0), (4, 10)), ((9e18, 9e18, 0), None)),
    ],
)
def test_directions_along_the_axes_have_a_pixel(point, pixel):
    row, column, _, inside = pixel_of(jnp.array(point, jnp.float32), ALL_AROUND)
    assert ((int(row), int(column)) if inside else None) == pixel


OUTSIDE = [(np.nan, 1, 0), (np.inf, 0, 0), *np.diag([-5, 0, 5]), (10.01, 0, 0)]
OUTSIDE += [5 * unit(SPEC.azimuth[1] + 1e-4, 0), 5 * unit(SPEC.azimuth[0] - 1e-4, 0)]
OUTSIDE += [5 * unit(0, edge) for edge in np.array(SPEC.elevation) + [-1e-4, 1e-4]]


@pytest.mark.parametrize("point", OUTSIDE)
def test_point_outside_leaves_no_pixel(point):
    valid = PointCloud(jnp.asarray([point], jnp.float32), jnp.array([True]))
    assert not project(valid, SPEC).any()
    assert not project(cloud(point), SPEC).any()
    invalid = PointCloud(jnp.array([[5.0, 0, 0]]), jnp.array([False]))
    assert not project(invalid, SPEC).any()


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(*3 * [st.floats(width=32)]), min_size=4, max_size=4))
def test_any_numbers_make_a_finite_image_within_range(points):
    image = project(cloud(*points), SPEC)
    assert jnp.isfinite(image).all() and (image >= 0).all()
    assert (image <= SPEC.max_range_m).all()


def test_image_to_cloud_to_image_is_exact():
    image = jax.random.uniform(jax.random.key(0), FINE.shape, minval=0.5, maxval=11)
    image = jnp.where(image > 8, 0.0, image)
    again = project(unproject(image, FINE), FINE)
    np.testing.assert_allclose(again, image, rtol=1e-6)


def test_each_slice_keeps_the_nearest_point_with_its_power_and_velocity():
    rng = np.random.default_rng(0)
    xyz = unit(rng.uniform(-1, 1, 500), rng.uniform(-0.3, 0.3, 500))
    xyz = (xyz * rng.uniform(1, 9, (500, 1))).astype(np.float32)
    power, velocity = np.exp(rng.normal(size=500)), rng.normal(size=500)
    points = PointCloud(*map(jnp.float32, (xyz, np.ones(500), velocity, power)))
    points = points._replace(valid=jnp.asarray(rng.random(500) < 0.9))
    images = project_slices(points, SPEC, num_slices=2)
    row, column, distance = equation_7(xyz, SPEC)
    expected = np.zeros((3, *SPEC.shape, 2))
    for i in np.flatnonzero(np.asarray(points.valid)):
        pixel = (int(row[i]), int(column[i]), int(distance[i] // 5))
        if not 0 < expected[0][pixel] <= distance[i]:
            expected[(slice(None), *pixel)] = distance[i], power[i], velocity[i]
    for image, reference in zip(images, expected, strict=True):
        np.testing.assert_allclose(image, reference, rtol=1e-5)
    near, far = np.moveaxis(expected[0], -1, 0)
    whole = np.where(near > 0, near, far)
    np.testing.assert_allclose(project(points, SPEC), whole, rtol=1e-5)


def test_of_equally_near_points_the_stronger_one_is_kept():
    points = cloud(*3 * [(5.0, 0.1, 0.1)])._replace(
        power=jnp.array([1.0, 3.0, 2.0]), velocity=jnp.array([-4.0, 1.0, 5.0])
    )
    images = project_slices(points, SPEC, num_slices=1)
    assert images.power.max() == 3
    assert images.velocity.sum() == 1


def test_without_power_and_velocity_they_are_one_and_none():
    images = project_slices(cloud((5, 0, 0), (5, 0, 0), (6, 1, 0)), SPEC, num_slices=3)
    np.testing.assert_array_equal(images.power, images.range_m > 0)
    assert images.velocity is None


def test_gradients_are_those_of_the_ranges_powers_and_velocities():
    def squares(xyz, velocity, power):
        points = cloud(xyz)._replace(velocity=velocity, power=power)
        images = project_slices(points, SPEC, num_slices=2)
        return sum((image**2).sum() for image in images)

    ahead = jnp.array([[4.0, 0, 0], [0, 0, 0], [6, 0, 0]])
    values = ahead, jnp.array([2.0, 3, 4]), jnp.ones(3)
    of_place, of_velocity, of_power = jax.grad(squares, (0, 1, 2))(*values)
    alone = jax.grad(lambda xyz: (project(cloud(xyz), SPEC) ** 2).sum())(ahead)
    # The second point has no direction, and the third one's slice is another.
    np.testing.assert_allclose(of_place[:, 0], [8, 0, 12], rtol=1e-6)
    np.testing.assert_allclose(alone[:, 0], [8, 0, 0], rtol=1e-6)
    np.testing.assert_allclose(of_velocity, [4, 0, 8])
    np.testing.assert_allclose(of_power, [2, 0, 2])


def test_real_lidar_scan_survives_within_half_a_pixel(samples):
    scan = np.load(samples / "ouster" / "os1_64_scan.npz")["xyz"].reshape(-1, 3)
    points = PointCloud.from_xyz(scan.astype(np.float32))
    image = project(points, FINE)
    row, column, distance, inside = map(np.asarray, pixel_of(points.xyz, FINE))
    survived = inside & np.asarray(points.valid)
    survived &= np.isclose(distance, np.asarray(image)[row, column], rtol=1e-6)
    assert survived.sum() > 2000
    assert survived.sum() >= (image > 0).sum()

    back = np.asarray(unproject(image, FINE).xyz).reshape(*FINE.shape, 3)[row, column]
    before, after = scan[survived].astype(float), back[survived].astype(float)
    ranges = [np.linalg.norm(xyz, axis=1) for xyz in (before, after)]
    np.testing.assert_allclose(ranges[1], ranges[0], rtol=1e-6)
    azimuths = [np.arctan2(xyz[:, 1], xyz[:, 0]) for xyz in (before, after)]
    pairs = zip((before, after), ranges, strict=True)
    elevations = [np.arcsin(xyz[:, 2] / r) for xyz, r in pairs]
    half_column, half_row = np.ptp(FINE.azimuth) / 1024, np.ptp(FINE.elevation) / 256
    assert np.abs(azimuths[1] - azimuths[0]).max() <= half_column * 1.001
    assert np.abs(elevations[1] - elevations[0]).max() <= half_row * 1.001


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"height": 0}, "image of 0 x 16 pixels"),
        ({"azimuth": (1.0, 0.5)}, "expected lowest < highest"),
        ({"elevation": (-2.0, 0.5)}, "expected lowest < highest within"),
        ({"max_range_m": math.inf}, "expected more than 0"),
    ],
)
def test_impossible_image_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        ImageSpec(**{"height": 8, "width": 16, **changes})
    with pytest.raises(ValueError, match=r"shape \(4, 4\), expected"):
        unproject(jnp.ones((4, 4)), SPEC)


@pytest.mark.usefixtures("as_a_user")
def test_batches_of_clouds_are_refused_and_mapped_as_the_loop():
    clouds = [cloud([3, 0, 0], [4, 1, 0.5]), cloud([4, 0.1, 0], [2, -1, 0.2])]
    batch = jax.tree.map(lambda *columns: jnp.stack(columns), *clouds)
    for function in (
        lambda c: project(c, SPEC),
        lambda c: project_slices(c, SPEC, num_slices=2).range_m,
        lambda c: condition_image(c, SPEC, num_slices=2),
    ):
        with pytest.raises(ValueError, match=r"\(2, 2, 3\).* use jax.vmap"):
            function(batch)
        for image, one in zip(jax.vmap(function)(batch), clouds, strict=True):
            np.testing.assert_array_equal(image, function(one))


def test_a_clouds_points_keep_the_confidence_of_their_pixels():
    image = RangeImage(jnp.zeros((2, *SPEC.shape)).at[:, 3, 4].set(2.0))
    assert image_cloud(image, SPEC).confidence is None
    confidence = jnp.zeros_like(image.range_m).at[1, 3, 4].set(0.7)
    image = image._replace(confidence=confidence)
    found = image_cloud(image, SPEC)
    assert found.valid.sum() == 2 and found.confidence is not None
    np.testing.assert_allclose(found.confidence[found.valid], [0.0, 0.7])


def test_the_gradient_of_a_rotation_through_pixels_is_0():
    still = jnp.array([[3.0, 0.2, 0.1], [5.0, -1.0, 0.4], [4.0, 2.0, -0.3]])

    def aside(yaw):
        cos, sin = jnp.cos(yaw), jnp.sin(yaw)
        rotation = jnp.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1.0]])
        image = project(PointCloud.from_xyz(still @ rotation), SPEC)
        return unproject(image, SPEC).xyz[:, 1].sum()

    assert abs(jax.grad(aside)(0.0)) < 1e-5
