"""Projection: Eq. 7 by hand, nearest wins, nothing wraps, slices, and the way back."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from jax.test_util import check_grads

from jradar.range_image import (
    ImageSpec,
    condition_image,
    nearest_points,
    pixel_directions,
    pixel_of,
    project,
    project_slices,
    unproject,
)
from jradar.types import PointCloud

SPEC = ImageSpec(height=8, width=16, max_range_m=10.0)
FINE = ImageSpec(height=128, width=512, max_range_m=12.0)
ALL_AROUND = ImageSpec(
    height=8,
    width=16,
    azimuth=(-math.pi, math.pi),
    elevation=(-math.pi / 2, math.pi / 2),
    max_range_m=10.0,
)


def direction(azimuth, elevation):
    ground = np.cos(elevation)
    x, y = ground * np.cos(azimuth), ground * np.sin(azimuth)
    return np.stack([x, y, np.sin(elevation) + 0 * x], -1)


def equation_7(xyz, spec):
    """Row, column (with their fractions) and range of points, in float64."""
    x, y, z = xyz.astype(np.float64).T
    distance = np.linalg.norm(xyz.astype(np.float64), axis=1)
    row = np.arccos(z / distance) - (math.pi / 2 - spec.elevation[1])
    column = np.arctan2(y, x) - spec.azimuth[0]
    return (
        row * spec.height / np.ptp(spec.elevation),
        column * spec.width / np.ptp(spec.azimuth),
        distance,
    )


def cloud(*points):
    return PointCloud.from_xyz(np.array(points, np.float32).reshape(-1, 3))


@pytest.mark.parametrize("spec", [SPEC, FINE, ALL_AROUND], ids=["8x16", "fine", "all"])
def test_pixel_is_equation_7_in_float64(spec):
    rng = np.random.default_rng(0)
    azimuth = rng.uniform(*spec.azimuth, 100_000)
    elevation = rng.uniform(*spec.elevation, 100_000)
    xyz = direction(azimuth, elevation) * rng.uniform(0.1, 9, (100_000, 1))
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
        ((1, 0, 0), (4, 8)),
        ((0, 1, 0), (4, 12)),
        ((0, -1, 0), (4, 4)),
        ((-1, -1e-6, 0), (4, 0)),
        ((0, 0, 1), (0, 8)),  # straight up, where no azimuth is defined
        ((1, 1, 0), (4, 10)),
        ((1e-18, 1e-18, 0), (4, 10)),
        ((9e18, 9e18, 0), None),
    ],
)
def test_directions_along_the_axes_have_a_pixel(point, pixel):
    row, column, _, inside = pixel_of(jnp.array(point, jnp.float32), ALL_AROUND)
    assert ((int(row), int(column)) if inside else None) == pixel


def test_up_is_row_0_and_left_is_the_last_column():
    up_left = 5 * direction(0.99 * SPEC.azimuth[1], 0.99 * SPEC.elevation[1])
    image = project(cloud(up_left), SPEC)
    assert np.argwhere(image).tolist() == [[0, 15]]


def test_nearest_point_wins_in_any_order():
    near, far = direction(0.1, 0.1) * 2, direction(0.1, 0.1) * 7
    for points in ((near, far), (far, near)):
        assert project(cloud(*points), SPEC).max() == pytest.approx(2, rel=1e-6)


def test_points_outside_and_invalid_ones_leave_no_pixel():
    outside = np.array(
        [
            (np.nan, 1, 0),
            (np.inf, 0, 0),
            (0, 0, 0),
            (-5, 0, 0),  # behind
            (0, 0, 5),  # straight up
            (10.01, 0, 0),
            *(5 * direction(edge * (1 + 1e-4), 0) for edge in SPEC.azimuth),
            *(5 * direction(0, edge * (1 + 1e-4)) for edge in SPEC.elevation),
        ],
        np.float32,
    )
    assert not project(PointCloud(outside, np.ones(10, bool)), SPEC).any()
    assert not project(cloud(*outside), SPEC).any()
    inside = np.tile(np.float32([5, 0, 0]), (10, 1))
    assert not project(PointCloud(inside, np.zeros(10, bool)), SPEC).any()


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(*3 * [st.floats(width=32)]), min_size=4, max_size=4))
def test_any_numbers_make_a_finite_image_within_range(points):
    image = np.asarray(project(cloud(*points), SPEC))
    assert ((image >= 0) & (image <= SPEC.max_range_m)).all()


def test_image_to_cloud_to_image_is_exact():
    image = np.random.default_rng(0).uniform(0.5, 11, FINE.shape)
    image = np.where(image > 8, 0.0, image).astype(np.float32)
    again = project(unproject(image, FINE), FINE)
    np.testing.assert_allclose(again, image, rtol=1e-6)


def test_slices_part_the_range_and_keep_the_power_of_the_nearest():
    points = PointCloud(
        xyz=np.float32(direction(0.1, 0.1) * np.array([[1], [2], [6], [9.9]])),
        valid=jnp.ones(4, bool),
        power=jnp.array([1.0, 5.0, 3.0, 4.0]),
    )
    slices = project_slices(points, SPEC, num_slices=4)
    ranges, powers = np.asarray(slices.range_m), np.asarray(slices.power)
    ((row, column),) = np.argwhere(np.asarray(project(points, SPEC)) == 1)
    np.testing.assert_allclose(ranges[row, column], [1, 0, 6, 9.9], rtol=1e-6)
    np.testing.assert_allclose(powers[row, column], [1, 0, 3, 4])
    assert (ranges > 0).sum() == 3


def test_power_and_velocity_are_those_of_the_nearest_point():
    rng = np.random.default_rng(0)
    xyz = direction(rng.uniform(-1, 1, 500), rng.uniform(-0.3, 0.3, 500))
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


def test_vmap_equals_the_loop():
    xyz = np.random.default_rng(0).normal(size=(3, 50, 3)) + [4.0, 0, 0]
    clouds = PointCloud.from_xyz(xyz.astype(np.float32))
    batch = np.asarray(jax.vmap(lambda c: project(c, SPEC))(clouds))
    for i in range(3):
        alone = project(jax.tree.map(lambda x, i=i: x[i], clouds), SPEC)
        np.testing.assert_array_equal(batch[i], alone)


def test_gradients_of_the_ranges_are_the_numerical_ones():
    directions = pixel_directions(SPEC)[2:4, 3:9].reshape(-1, 3)

    @jax.jit
    def total(ranges):
        points = PointCloud(ranges[:, None] * directions, np.ones(12, bool))
        return (project(points, SPEC) ** 2).sum()

    ranges = jnp.linspace(2.0, 6.0, 12)
    check_grads(total, (ranges,), order=1, modes=["rev"], rtol=1e-2)


def test_gradients_reach_the_nearest_points_and_are_finite_at_the_origin():
    @jax.jit
    def slopes(cloud):
        def total(cloud):
            images = project_slices(cloud, SPEC, num_slices=2)
            return sum((image**2).sum() for image in images)

        return jax.grad(total, allow_int=True)(cloud)

    measured = cloud((4, 0, 0), (0, 0, 0), (6, 0, 0))._replace(
        valid=jnp.ones(3, bool), power=jnp.ones(3), velocity=jnp.array([2.0, 3.0, 4.0])
    )
    found = slopes(measured)
    np.testing.assert_allclose(found.xyz[:, 0], [8, 0, 12], rtol=1e-6)
    np.testing.assert_allclose(found.power, [2, 0, 2])
    np.testing.assert_allclose(found.velocity, [4, 0, 8])


def test_real_lidar_scan_survives_within_half_a_pixel(samples):
    scan = np.load(samples / "ouster" / "os1_64_scan.npz")["xyz"].reshape(-1, 3)
    points = PointCloud.from_xyz(scan.astype(np.float32))
    image = project(points, FINE)
    row, column, distance, inside = map(np.asarray, pixel_of(points.xyz, FINE))
    survived = inside & np.asarray(points.valid)
    survived &= np.isclose(distance, np.asarray(image)[row, column], rtol=1e-6)
    assert survived.sum() > 2000 and survived.sum() >= (image > 0).sum()

    back = np.asarray(unproject(image, FINE).xyz).reshape(*FINE.shape, 3)[row, column]
    before, after = (
        np.array(equation_7(xyz[survived].astype(float), FINE)) for xyz in (scan, back)
    )
    rows, columns, ranges = np.abs(after - before)
    assert rows.max() <= 0.5005 and columns.max() <= 0.5005
    np.testing.assert_allclose(ranges, 0, atol=1e-5)


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


def test_image_of_another_spec_is_refused():
    with pytest.raises(ValueError, match=r"shape \(4, 4\), expected"):
        unproject(jnp.ones((4, 4)), SPEC)


@pytest.mark.usefixtures("as_a_user")
def test_batches_of_clouds_are_refused_with_the_mend():
    one = cloud([3, 0, 0], [4, 1, 0.5])
    batch = jax.tree.map(lambda column: jnp.stack([column, column]), one)
    for function in (
        lambda c: project(c, SPEC),
        lambda c: project_slices(c, SPEC, num_slices=2).range_m,
        lambda c: condition_image(c, SPEC, num_slices=2),
    ):
        with pytest.raises(ValueError, match=r"\(2, 2, 3\).* use jax.vmap"):
            function(batch)
        for image in jax.vmap(function)(batch):
            np.testing.assert_array_equal(image, function(one))


def test_nearest_points_are_those_that_the_image_keeps():
    rng = np.random.default_rng(0)
    xyz = direction(rng.uniform(-0.9, 0.9, 300), rng.uniform(-0.3, 0.3, 300))
    xyz = (xyz * rng.uniform(2, 9, (300, 1))).astype(np.float32)
    valid = np.arange(300) % 7 > 0
    many = PointCloud(xyz, valid, power=np.arange(300, dtype=np.float32))
    kept = jax.tree.map(np.asarray, nearest_points(many, SPEC))
    image = np.asarray(project(many, SPEC))
    np.testing.assert_array_equal(kept.valid, image.ravel() > 0)
    np.testing.assert_array_equal(project(kept, SPEC), image)
    number = kept.power[kept.valid].astype(int)
    assert 20 < len(number) == len({*number})
    np.testing.assert_array_equal(kept.xyz[kept.valid], xyz[number])
    assert kept.velocity is None and not kept.xyz[~kept.valid].any()
    none = nearest_points(cloud(), SPEC)
    assert none.xyz.shape == (8 * 16, 3) and not none.valid.any()


def test_gradient_of_a_turn_is_complete_through_nearest_points_and_none_without():
    still = np.float32([[3.0, 0.2, 0.1], [5.0, -1.0, 0.4], [4.0, 2.0, -0.3]])

    def slope(keep):
        @jax.jit
        @jax.grad
        def aside(yaw):
            cos, sin = jnp.cos(yaw), jnp.sin(yaw)
            turn = jnp.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1.0]])
            return keep(PointCloud.from_xyz(still @ turn), SPEC).xyz[:, 1].sum()

        return float(aside(0.0))

    expected = still[:, 0].sum()  # d y / d yaw = x
    assert slope(nearest_points) == pytest.approx(expected, rel=1e-5)
    through_pixels = slope(lambda cloud, spec: unproject(project(cloud, spec), spec))
    assert abs(through_pixels) < 1e-5
