"""RPDNet's training: labels by hand and by the simulator, losses, the critic."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.rpdnet.labels import label_cells, sensor_velocities
from experiments.rpdnet.loss import focal_loss, rpdnet_loss, rpdnet_params
from jradar.baselines import RPDNet
from jradar.radar import Radar, RadarSpec, Scatterers, all_cells, simulate_cube

KEY = jax.random.key(0)
RADAR = RadarSpec.awr1843(num_chirps=32, num_samples=64)
SMALL = RPDNet(channels=4, levels=3)


def test_the_label_lies_where_the_radar_sees_a_static_point():
    velocity = np.array([0.6, 0.2, 0.0])
    points = np.array([[3.0, 0.4, 0.1], [1.5, -1.0, 0.0], [2.0, 2.0, 0.3]])
    for point in points:
        receding = -(point @ velocity) / np.linalg.norm(point)
        scatterer = Scatterers(
            jnp.asarray(point[None], jnp.float32),
            jnp.asarray(receding[None], jnp.float32),
            jnp.ones(1),
        )
        cube = simulate_cube(KEY, scatterer, RADAR, noise_power=1e-4)
        power = np.asarray(all_cells(cube, Radar(RADAR)).power)
        label = label_cells(point[None], velocity, power, RADAR)
        strongest = np.unravel_index(power.argmax(), power.shape)
        assert label[strongest] and 1 <= label.sum() <= 9


def test_labels_need_power_and_wrap_around_in_velocity():
    power = np.ones((16, 32))
    step = RADAR.velocity_resolution_mps
    ahead = np.array([[10 * RADAR.range_resolution_m, 0, 0]])
    nothing = label_cells(ahead, np.zeros(3), power, RADAR)
    assert not nothing.any()
    power[8, 10] = power[7, 10] = 10.0
    expected = np.zeros(power.shape, bool)
    expected[[7, 8], 10] = True
    for cells in (0, 16, -32):
        velocity = np.array([cells * step, 0, 0])
        found = label_cells(ahead, velocity, power, RADAR)
        np.testing.assert_array_equal(found, expected)
    nearer = ahead - np.array([[3 * RADAR.range_resolution_m, 0, 0]])
    biased = label_cells(
        nearer, np.zeros(3), power, RADAR, range_bias_m=3 * RADAR.range_resolution_m
    )
    np.testing.assert_array_equal(biased, expected)
    beyond = np.array([[40 * RADAR.range_resolution_m, 0, 0], [0, 0, 0]])
    assert not label_cells(beyond, np.zeros(3), power, RADAR).any()


def test_velocity_is_in_the_sensors_own_frame():
    stamps = np.array([0.0, 0.1, 0.21, 0.3, 9.0])
    poses = np.tile(np.eye(4), (5, 1, 1))
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])  # x of the sensor is y
    poses[:, :3, :3] = turn
    poses[:, 1, 3] = 1.5 * stamps
    found = sensor_velocities(stamps, poses)
    np.testing.assert_allclose(found[:4], np.tile([1.5, 0, 0], (4, 1)), atol=1e-9)
    assert np.isnan(found[4]).all()
    poses[1] = np.nan
    found = sensor_velocities(stamps, poses)
    assert np.isfinite(found).all(-1).tolist() == [False, False, True, True, False]


def test_focal_loss_is_cross_entropy_for_gamma_0_and_the_formula_otherwise():
    logits, labels = jnp.array([2.0, -1.0, 0.5]), jnp.array([1.0, 0.0, 0.0])
    right = jax.nn.sigmoid(jnp.where(labels > 0, logits, -logits))
    np.testing.assert_allclose(
        focal_loss(logits, labels, gamma=0.0), -np.log(right).mean(), rtol=1e-6
    )
    expected = (-((1 - right) ** 2) * np.log(right)).mean()
    np.testing.assert_allclose(focal_loss(logits, labels), expected, rtol=1e-6)


def gradient_of(weight):
    """The loss, its parts and their gradient; compiled once for each weight."""
    loss = functools.partial(rpdnet_loss, SMALL, weight=weight)
    return jax.jit(jax.value_and_grad(loss, has_aux=True))


WITHOUT, WITH_CRITIC = gradient_of(0.0), gradient_of(0.5)


@pytest.fixture(scope="module")
def params():
    return rpdnet_params(jax.random.key(0, impl="rbg"), SMALL, (16, 16))


def test_detector_descends_the_distance_that_the_critic_climbs(params):
    maps = jax.random.uniform(KEY, (2, 16, 16, 1))
    labels = (maps > 0.9).astype(jnp.float32)
    (plain, _), without = WITHOUT(params, maps, labels)
    (value, parts), both = WITH_CRITIC(params, maps, labels)
    np.testing.assert_allclose(value, plain + 0.5 * parts["distance"], rtol=1e-5)
    assert all((leaf == 0).all() for leaf in jax.tree.leaves(without["critic"]))
    pull = jax.tree.map(jnp.subtract, both["detector"], without["detector"])
    assert max(abs(leaf).max() for leaf in jax.tree.leaves(pull)) > 1e-5
    moved = jax.tree.map(lambda p, g: p - 1e-2 * g, params["critic"], both["critic"])
    (_, after), _ = WITH_CRITIC({**params, "critic": moved}, maps, labels)
    assert after["distance"] > parts["distance"]


def test_a_perfect_mask_is_at_no_distance(params):
    maps = jnp.ones((2, 16, 16, 1))
    nothing = jax.tree.map(jnp.zeros_like, params["detector"])
    for bias, distance in ((20.0, 0.0), (-20.0, 0.1)):
        nothing["params"]["logits"]["bias"] = jnp.array([bias])
        (_, parts), _ = WITH_CRITIC({**params, "detector": nothing}, maps, maps)
        assert (parts["distance"] == 0) == (distance == 0)
        assert parts["distance"] >= distance
