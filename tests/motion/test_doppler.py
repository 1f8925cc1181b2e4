"""Ego velocity: closed forms, its covariance, movers, folds, transforms, real scans."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.motion import ego_velocity
from jradar.radar.angle.deviations import Deviations
from jradar.recordings import open_bag
from jradar.types import PointCloud

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
    direction = np.stack(
        [
            np.cos(azimuth) * np.cos(elevation),
            np.sin(azimuth) * np.cos(elevation),
            np.sin(elevation),
        ],
        -1,
    )
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
    return jax.device_put(cloud), moving


def padded(cloud, points=POINTS):
    """The cloud with invalid points, whose values must not matter."""
    more = points - len(cloud.valid)
    return PointCloud(
        jnp.pad(cloud.xyz, ((0, more), (0, 0)), constant_values=jnp.nan),
        jnp.pad(cloud.valid, (0, more)),
        jnp.pad(cloud.velocity, (0, more), constant_values=jnp.nan),
        snr=jnp.pad(cloud.snr, (0, more), constant_values=jnp.nan),
    )


def test_exact_points_give_the_exact_velocity():
    cloud, _ = cloud_of(1)
    found = ego_velocity(KEY, cloud)
    np.testing.assert_allclose(found.velocity, VELOCITY, atol=1e-4)
    assert found.solved and found.inliers.all() and not found.moving.any()


def test_padding_does_not_matter():
    cloud, _ = cloud_of(1, points=20)
    found = ego_velocity(KEY, padded(cloud))
    np.testing.assert_allclose(found.velocity, VELOCITY, atol=1e-4)
    assert found.inliers.tolist() == [True] * 20 + [False] * (POINTS - 20)
    assert np.isfinite(found.covariance).all()


def test_closing_in_on_what_is_ahead_makes_its_velocity_negative():
    cloud, _ = cloud_of(1, np.array([2.0, 0.0, 0.0]))
    assert (cloud.velocity < 0).all()
    assert ego_velocity(KEY, cloud).velocity[0] > 1.99


def test_movers_are_told_from_what_stands_still():
    cloud, movers = cloud_of(2, noise=0.02, movers=0.4)
    found = ego_velocity(KEY, cloud)
    np.testing.assert_allclose(found.velocity, VELOCITY, atol=0.05)
    np.testing.assert_array_equal(found.moving, movers)
    np.testing.assert_array_equal(found.inliers, ~movers)


def many(noise, count, **options):
    clouds = [cloud_of(seed, noise=noise)[0] for seed in range(count)]
    clouds = jax.tree.map(lambda *leaves: jnp.stack(leaves), *clouds)
    keys = jax.random.split(KEY, count)
    solve = jax.vmap(functools.partial(ego_velocity, **options))
    return keys, clouds, solve(keys, clouds)


def test_covariance_is_that_of_many_draws():
    *_, found = many(0.03, 400)
    error = np.asarray(found.velocity, float) - VELOCITY
    whitened = np.einsum(
        "ni,nij,nj->n", error, np.linalg.inv(np.float64(found.covariance)), error
    )
    np.testing.assert_allclose(whitened.mean() / 3, 1.0, atol=0.25)
    ratio = error.var(0) / np.mean(np.diagonal(found.covariance, 0, 1, 2), 0)
    np.testing.assert_allclose(ratio, 1.0, atol=0.3)


def test_vmap_equals_the_loop():
    keys, clouds, found = many(0.03, 4)
    for k in range(4):
        one = ego_velocity(keys[k], jax.tree.map(lambda leaf, k=k: leaf[k], clouds))
        for batch, single in zip(found, one, strict=True):
            np.testing.assert_allclose(batch[k], single, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("speed", [0.5, 1.7, 2.6])
def test_aliased_velocities_are_folded_back(speed):
    velocity = speed * np.array([0.9, 0.4, 0.1])
    cloud, movers = cloud_of(3, velocity, noise=0.01, movers=0.2)
    aliased = jnp.mod(cloud.velocity + 1.0, 2.0) - 1.0
    found = ego_velocity(KEY, cloud._replace(velocity=aliased), unambiguous_mps=1.0)
    np.testing.assert_allclose(found.velocity, velocity, atol=0.03)
    assert found.inliers[~movers].all()


def test_without_elevation_the_height_is_unknown():
    cloud, movers = cloud_of(4, np.array([1.0, 0.3, 0.0]), movers=0.3)
    flat = np.asarray(cloud.xyz) * [1, 1, 0]
    direction = flat / np.linalg.norm(flat, axis=-1, keepdims=True)
    doppler = np.where(movers, cloud.velocity, -direction @ [1.0, 0.3, 0.0])
    cloud = cloud._replace(xyz=jnp.asarray(flat), velocity=jnp.asarray(doppler))
    found = ego_velocity(KEY, cloud, elevation=False)
    np.testing.assert_allclose(found.velocity, [1.0, 0.3, 0.0], atol=1e-4)
    assert np.isinf(found.covariance[2, 2])
    assert np.isfinite(np.asarray(found.covariance)[:2]).all()
    assert not ego_velocity(KEY, cloud).solved  # all echoes lie in one plane


@pytest.mark.parametrize("points", [0, 1, 4])
def test_too_few_points_are_unsolved(points):
    found = ego_velocity(KEY, padded(cloud_of(1, points=points)[0]))
    assert not found.solved
    assert np.isnan(found.velocity).all()
    np.testing.assert_array_equal(
        found.covariance, np.where(np.eye(3, dtype=bool), np.inf, 0)
    )
    assert not found.inliers.any() and not found.moving.any()


def test_echoes_of_one_direction_are_unsolved():
    cloud, _ = cloud_of(1)
    alike = cloud._replace(
        xyz=jnp.broadcast_to(cloud.xyz[:1], cloud.xyz.shape),
        velocity=jnp.full(POINTS, -1.0),
    )
    assert not ego_velocity(KEY, alike).solved


def test_gradients_are_finite_and_those_of_least_squares():
    cloud, _ = cloud_of(5, noise=0.02, movers=0.2)

    def forward(doppler):
        return ego_velocity(KEY, cloud._replace(velocity=doppler)).velocity[0]

    slope = jax.grad(forward)(cloud.velocity)
    step = jnp.where(jnp.arange(POINTS) % 3 == 0, 1e-2, 0.0)
    change = forward(cloud.velocity + step) - forward(cloud.velocity - step)
    np.testing.assert_allclose(2 * slope @ step, change, rtol=0.05, atol=1e-5)
    assert (slope[found_movers(cloud)] == 0).all()
    few = padded(cloud_of(1, points=2)[0])
    slope = jax.grad(
        lambda xyz: jnp.nansum(ego_velocity(KEY, few._replace(xyz=xyz)).velocity)
    )(few.xyz)
    assert np.isfinite(slope).all()


def found_movers(cloud):
    return np.asarray(ego_velocity(KEY, cloud).moving)


def test_echoes_with_small_deviations_count_more():
    random = np.random.default_rng(6)
    cloud, _ = cloud_of(6)
    deviation = np.where(np.arange(POINTS) % 2, 0.002, 0.05)
    doppler = cloud.velocity + deviation * random.standard_normal(POINTS)
    cloud = cloud._replace(velocity=jnp.asarray(doppler, jnp.float32), snr=None)
    known = Deviations(
        jnp.zeros(POINTS),
        jnp.asarray(deviation, jnp.float32),
        jnp.full(POINTS, 1e-3),
        jnp.full(POINTS, jnp.inf),
    )
    options = {"noise_mps": 0.001}
    plain = ego_velocity(KEY, cloud, **options)
    weighted = ego_velocity(KEY, cloud, deviations=known, **options)
    errors = [np.linalg.norm(f.velocity - VELOCITY) for f in (plain, weighted)]
    assert errors[1] < errors[0] / 2
    assert weighted.covariance[0, 0] < plain.covariance[0, 0] / 4


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"threshold_mps": 0.0}, "threshold_mps=0.0"),
        ({"unambiguous_mps": 0.1}, "would fit any velocity"),
        ({"least_inliers": 3}, "more than the 3 unknowns"),
        ({"folds": 9, "unambiguous_mps": 1.0}, "at most 65,536"),
    ],
)
def test_options_that_cannot_be_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        ego_velocity(KEY, cloud_of(1)[0], **options)


def test_clouds_without_velocity_and_batches_are_refused():
    cloud, _ = cloud_of(1)
    with pytest.raises(ValueError, match="no velocity"):
        ego_velocity(KEY, cloud._replace(velocity=None))
    with pytest.raises(ValueError, match="jax.vmap"):
        ego_velocity(KEY, jax.tree.map(lambda leaf: leaf[None], cloud))


def test_real_scans_of_a_radar_carried_by_hand(samples):
    """REVE's demo: the rig stands for 12 s, is carried for 20 s, and stands again."""
    path = samples / "reve" / "demo_ti_mmwave_rospkg_format.bag"
    if not path.is_file():
        pytest.skip("no scans of REVE's demo among the real captures")
    scans = open_bag(path)
    points = [scans.read_points(k) for k in range(0, len(scans), 4)]

    def table(name):
        return np.stack(
            [
                np.pad(p[name][:POINTS], (0, max(POINTS - len(p[name]), 0)))
                for p in points
            ]
        ).astype(np.float32)

    valid = np.arange(POINTS) < np.array([len(p["x"]) for p in points])[:, None]
    xyz = np.stack([table(name) for name in "xyz"], -1)
    snr = 10 ** (table("intensity") / 10)
    clouds = jax.device_put(PointCloud(xyz, valid, table("velocity"), snr=snr))
    found = jax.vmap(ego_velocity)(jax.random.split(KEY, len(points)), clouds)
    assert found.solved.all()
    share = found.inliers.sum(1) / valid.sum(1)
    assert np.median(share) > 0.95 and share.min() > 0.3
    speed = np.linalg.norm(found.velocity, axis=-1)
    seconds = scans.stamps[::4] - scans.stamps[0]
    assert (speed[(seconds < 12) | (seconds > 37)] < 0.05).all()
    walking = (seconds > 16) & (seconds < 32)
    assert 0.9 < np.median(speed[walking]) < 1.6 and speed.max() < 2.5
    assert np.median(found.velocity[walking, 0]) > 0.3  # the radar looks ahead
