"""Ego velocity: closed forms, its covariance, movers, folds, transforms, real scans."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.motion import ego_velocity
from jradar.recordings.bags.bags import open_bag
from jradar.types import PointCloud
from tests.directions import unit

POINTS = 96
VELOCITY = np.array([1.3, -0.4, 0.2])
KEY = jax.random.key(0)


def cloud_of(seed, velocity=VELOCITY, *, points=POINTS, noise=0.0, movers=0.0):
    """A cloud of echoes in front of a moving radar; the first ones move by themselves.

    Returns the cloud and the mask of movers.
    """
    random = np.random.default_rng(seed)
    azimuth = random.uniform(-1.0, 1.0, points)
    elevation = random.uniform(-0.4, 0.4, points)
    direction = unit(azimuth, elevation)
    doppler = -direction @ velocity + noise * random.standard_normal(points)
    moving = np.arange(points) < round(movers * points)
    own = random.uniform(0.5, 2.0, points) * random.choice([-1, 1], points)
    doppler = np.where(moving, doppler + own, doppler)
    ranges = random.uniform(0.5, 10.0, points)
    cloud = PointCloud(
        xyz=np.float32(ranges[:, None] * direction),
        valid=np.ones(points, bool),
        velocity=np.float32(doppler),
        snr=np.float32(10 ** random.uniform(1, 4, points)),
    )
    return cloud, moving


def padded(cloud, points=POINTS):
    """The cloud with invalid points, whose values must not matter."""

    def more(column, value=np.nan):
        added = np.full((points - len(column), *column.shape[1:]), value, column.dtype)
        return np.concatenate([column, added])

    xyz, velocity, snr = map(more, (cloud.xyz, cloud.velocity, cloud.snr))
    return PointCloud(xyz, more(cloud.valid, False), velocity, snr=snr)


@pytest.mark.parametrize("points", [POINTS, 20])
def test_exact_points_give_the_exact_velocity_whatever_the_padding(points):
    cloud, _ = cloud_of(1, points=points)
    found = ego_velocity(KEY, padded(cloud))
    np.testing.assert_allclose(found.velocity, VELOCITY, atol=1e-4)
    assert found.inliers.tolist() == [True] * points + [False] * (POINTS - points)
    assert np.isfinite(found.covariance).all()
    assert found.solved and not found.moving.any()


@pytest.mark.parametrize("kind", ["float16", "bfloat16"])
def test_half_precision_gives_nearly_the_same_velocity(kind):
    cloud, _ = cloud_of(1)
    half = jax.tree.map(lambda x: x if x.dtype == bool else jnp.asarray(x, kind), cloud)
    found = ego_velocity(KEY, half)
    np.testing.assert_allclose(found.velocity, VELOCITY, atol=5e-3)
    assert found.inliers.all() and np.isfinite(found.covariance).all()


def test_movers_are_told_from_what_stands_still():
    cloud, movers = cloud_of(2, noise=0.02, movers=0.4)
    found = ego_velocity(KEY, cloud)
    np.testing.assert_allclose(found.velocity, VELOCITY, atol=0.05)
    np.testing.assert_array_equal(found.moving, movers)
    np.testing.assert_array_equal(found.inliers, ~movers)


@functools.cache
def many():
    """400 clouds, and what is found in them."""
    clouds = [cloud_of(seed, noise=0.03)[0] for seed in range(400)]
    clouds = jax.tree.map(lambda *leaves: np.stack(leaves), *clouds)
    keys = jax.random.split(KEY, 400)
    found = jax.vmap(ego_velocity)(keys, clouds)
    return keys, clouds, jax.tree.map(np.asarray, found)


def test_covariance_is_that_of_many_draws():
    *_, found = many()
    error = found.velocity - VELOCITY
    inverse = np.linalg.inv(found.covariance.astype(float))
    whitened = np.einsum("ni,nij,nj->n", error, inverse, error)
    np.testing.assert_allclose(whitened.mean() / 3, 1.0, atol=0.25)
    ratio = error.var(0) / np.mean(np.diagonal(found.covariance, 0, 1, 2), 0)
    np.testing.assert_allclose(ratio, 1.0, atol=0.3)


def test_covariance_of_few_echoes_is_that_of_many_draws_of_their_noise():
    cloud, _ = cloud_of(1, points=8)
    noise = 0.02 * np.random.default_rng(0).standard_normal((1000, 8))
    found = jax.vmap(
        lambda doppler: ego_velocity(
            KEY, cloud._replace(velocity=doppler, snr=None), noise_mps=1e-6
        )
    )(np.float32(cloud.velocity + noise))
    variance = np.diagonal(found.covariance, 0, 1, 2).mean(0)
    np.testing.assert_allclose(variance / np.var(found.velocity, 0), 1.0, atol=0.15)


@pytest.mark.parametrize("noise_mps", [1e-4, 0.02])
def test_covariance_is_its_formula_where_one_echo_alone_shows_the_elevation(noise_mps):
    """HC2 in float64, with leverages cut off at 0.9 and residuals at the noise."""
    elevation = 0.02 * np.cos(np.arange(8.0))
    elevation[3] = 0.6
    direction = unit(np.linspace(-1, 1, 8), elevation)
    doppler = -direction @ VELOCITY + 0.05 * np.sin(np.arange(8.0))
    cloud = PointCloud(np.float32(direction), np.ones(8, bool), np.float32(doppler))
    found = ego_velocity(KEY, cloud, threshold_mps=1.0, noise_mps=noise_mps)
    inverse = np.linalg.inv(direction.T @ direction)
    leverage = np.einsum("pi,ij,pj->p", direction, inverse, direction)
    square = (doppler + direction @ found.velocity) ** 2 / np.maximum(1 - leverage, 0.1)
    weighted = np.maximum(square, noise_mps**2)[:, None] * direction
    expected = inverse @ weighted.T @ direction @ inverse
    assert leverage.max() > 0.95
    np.testing.assert_allclose(found.covariance, expected, rtol=0.01)


def test_vmap_equals_the_loop():
    keys, clouds, found = many()
    for k in range(4):
        one = ego_velocity(keys[k], jax.tree.map(lambda leaf, k=k: leaf[k], clouds))
        for batch, single in zip(found, one, strict=True):
            np.testing.assert_allclose(batch[k], single, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("speed", [0.5, 1.7, 2.6])
def test_aliased_velocities_are_folded_back(speed):
    velocity = speed * np.array([0.9, 0.4, 0.1])
    cloud, movers = cloud_of(3, velocity, noise=0.01, movers=0.2)
    aliased = np.mod(cloud.velocity + 1.0, 2.0) - 1.0
    found = ego_velocity(KEY, cloud._replace(velocity=aliased), unambiguous_mps=1.0)
    np.testing.assert_allclose(found.velocity, velocity, atol=0.03)
    assert np.asarray(found.inliers)[~movers].all()


def test_without_elevation_the_height_is_unknown():
    cloud, movers = cloud_of(4, np.array([1.0, 0.3, 0.0]), movers=0.3)
    flat = cloud.xyz * np.float32([1, 1, 0])
    direction = flat / np.linalg.norm(flat, axis=-1, keepdims=True)
    doppler = np.where(movers, cloud.velocity, -direction @ [1.0, 0.3, 0.0])
    cloud = cloud._replace(xyz=flat, velocity=np.float32(doppler))
    found = ego_velocity(KEY, cloud, elevation=False)
    np.testing.assert_allclose(found.velocity, [1.0, 0.3, 0.0], atol=1e-4)
    assert np.isinf(found.covariance[2, 2])
    assert np.isfinite(np.asarray(found.covariance)[:2]).all()
    assert not ego_velocity(KEY, cloud).solved  # all echoes lie in one plane


@pytest.mark.parametrize("points", [0, 1, 4, "one direction"])
def test_too_few_points_and_those_of_one_direction_are_unsolved(points):
    wanted = POINTS if points == "one direction" else points
    cloud = padded(cloud_of(1, points=wanted)[0])
    if points == "one direction":
        alike = np.full(POINTS, -1.0, np.float32)
        cloud = cloud._replace(xyz=0 * cloud.xyz + cloud.xyz[:1], velocity=alike)
    found = ego_velocity(KEY, cloud)
    assert not found.solved
    assert np.isnan(found.velocity).all()
    expected = np.where(np.eye(3, dtype=bool), np.inf, 0)
    np.testing.assert_array_equal(found.covariance, expected)
    assert not found.inliers.any() and not found.moving.any()


@pytest.mark.parametrize("elevation", [True, False])
def test_points_without_a_direction_have_no_gradient(elevation):
    """At the origin, nearer than float32 resolves, and infinitely far away."""
    cloud, _ = cloud_of(3, np.array([1.3, -0.4, 0.0]), noise=0.02)

    @jax.jit
    @functools.partial(jax.grad, argnums=(0, 1))
    def slopes(xyz, velocity):
        moved = cloud._replace(xyz=xyz, velocity=velocity)
        found = ego_velocity(KEY, moved, elevation=elevation)
        known = jnp.where(jnp.isfinite(found.covariance), found.covariance, 0.0)
        return found.velocity[0] + known.sum()

    for value in (0.0, 1e-30, 1e-22, 1e30, np.inf, np.nan):
        xyz = cloud.xyz.copy()
        xyz[:2] = value
        for slope in slopes(xyz, cloud.velocity):
            assert np.isfinite(slope).all()
            assert not slope[:2].any() and np.abs(slope[2:]).max() > 1e-3


@pytest.mark.slow
def test_gradients_are_finite_and_those_of_least_squares():
    cloud, _ = cloud_of(5, noise=0.02, movers=0.2)

    @jax.jit
    def forward(doppler, cloud=cloud):
        return ego_velocity(KEY, cloud._replace(velocity=doppler)).velocity[0]

    slope = np.asarray(jax.jit(jax.grad(forward))(cloud.velocity))
    step = np.where(np.arange(POINTS) % 3 == 0, 1e-2, 0.0).astype(np.float32)
    change = forward(cloud.velocity + step) - forward(cloud.velocity - step)
    np.testing.assert_allclose(2 * slope @ step, change, rtol=0.05, atol=1e-5)
    assert (slope[np.asarray(ego_velocity(KEY, cloud).moving)] == 0).all()

    @jax.jit
    @jax.grad
    def few(xyz):
        cloud = padded(cloud_of(1, points=2)[0])
        return jnp.nansum(ego_velocity(KEY, cloud._replace(xyz=xyz)).velocity)

    assert np.isfinite(few(padded(cloud_of(1, points=2)[0]).xyz)).all()


@pytest.mark.parametrize(
    ("change", "options", "message"),
    [
        ({}, {"threshold_mps": 0.0}, "threshold_mps=0.0"),
        ({}, {"unambiguous_mps": 0.1}, "would fit any velocity"),
        ({}, {"least_inliers": 3}, "more than the 3 unknowns"),
        ({}, {"folds": 9, "unambiguous_mps": 1.0}, "at most 65,536"),
        ({"velocity": None}, {}, "no velocity"),
        ({"xyz": np.zeros((1, 9, 3)), "valid": np.ones((1, 9))}, {}, "jax.vmap"),
    ],
)
@pytest.mark.usefixtures("as_a_user")
def test_what_cannot_be_is_refused(change, options, message):
    with pytest.raises(ValueError, match=message):
        ego_velocity(KEY, cloud_of(1)[0]._replace(**change), **options)


def test_real_scans_of_a_radar_carried_by_hand(samples):
    """REVE's demo: the rig stands for 12 s, is carried for 20 s, and stands again."""
    path = samples / "reve" / "demo_ti_mmwave_rospkg_format.bag"
    if not path.is_file():
        pytest.skip("no scans of REVE's demo among the real captures")
    scans = open_bag(path)
    points = [scans.read_points(k) for k in range(0, len(scans), 4)]

    def table(name):
        rows = np.zeros((len(points), POINTS), np.float32)
        for row, found in zip(rows, points, strict=True):
            some = found[name][:POINTS]
            row[: len(some)] = some
        return rows

    valid = np.arange(POINTS) < np.array([len(p["x"]) for p in points])[:, None]
    xyz = np.stack([table(name) for name in "xyz"], -1)
    snr = 10 ** (table("intensity") / 10)
    clouds = PointCloud(xyz, valid, table("velocity"), snr=snr)
    found = jax.vmap(ego_velocity)(jax.random.split(KEY, len(points)), clouds)
    found = jax.tree.map(np.asarray, found)
    assert found.solved.all()
    share = found.inliers.sum(1) / valid.sum(1)
    assert np.median(share) > 0.95 and share.min() > 0.3
    speed = np.linalg.norm(found.velocity, axis=-1)
    seconds = scans.stamps[::4] - scans.stamps[0]
    assert (speed[(seconds < 12) | (seconds > 37)] < 0.05).all()
    walking = (seconds > 16) & (seconds < 32)
    assert 0.9 < np.median(speed[walking]) < 1.6 and speed.max() < 2.5
    assert np.median(found.velocity[walking, 0]) > 0.3  # the radar looks ahead
