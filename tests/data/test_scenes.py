"""Rooms: rays against a march, floor removed, the radar sees what the LiDAR sees."""

import jax
import jax.numpy as jnp
import numpy as np

from jradar.data import Room, cast_rays, random_room, room_frame, room_scatterers
from jradar.radar import RadarSpec, radar_points
from jradar.range_image import ImageSpec

RADAR = RadarSpec.awr1843(num_chirps=32, num_samples=64)
IMAGE = ImageSpec(height=16, width=32)


def march(room, direction):
    """First step of 1 cm at which the ray is outside the shell or in a box."""
    yaw, shell, boxes = float(room.yaw), np.asarray(room.shell), np.asarray(room.boxes)
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    steps = np.arange(0.005, 20, 0.01)[:, None] * direction
    steps[:, :2] = steps[:, :2] @ turn.T
    hit = ((steps < shell[0]) | (steps > shell[1])).any(1)
    for low, high in boxes:
        hit |= ((steps > low) & (steps < high)).all(1)
    return 0.005 + 0.01 * hit.argmax()


def test_rays_meet_the_first_surface():
    rng = np.random.default_rng(0)
    for seed in range(5):
        room = random_room(jax.random.key(seed))
        directions = rng.normal(size=(40, 3)) * [1, 1, 0.3] + [1, 0, 0]
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        distance, _ = cast_rays(room, jnp.asarray(directions, jnp.float32))
        expected = [march(room, direction) for direction in directions]
        # A march of 1 cm misses corners that are cut by less.
        close = np.abs(np.asarray(distance) - expected) < 0.02
        assert close.mean() > 0.98


def test_floor_and_ceiling_are_not_upright():
    shell = jnp.array([[-5.0, -5, -1], [5, 5, 2]])
    room = Room(shell, jnp.full((1, 2, 3), 50.0), jnp.array(0.0))
    rays = jnp.array([[0.0, 0, -1], [0, 0, 1], [1, 0, 0], [0, -1, 0]])
    distance, upright = cast_rays(room, rays)
    np.testing.assert_allclose(distance, [1, 2, 5, 5])
    assert upright.tolist() == [False, False, True, True]


def test_scatterers_lie_on_surfaces_and_fade_with_distance_squared():
    room = random_room(jax.random.key(3))
    scatterers = room_scatterers(jax.random.key(0), room)
    distance = jnp.linalg.norm(scatterers.xyz, axis=-1)
    surface, upright = cast_rays(room, scatterers.xyz / distance[:, None])
    np.testing.assert_allclose(distance, surface, rtol=1e-5)
    assert not scatterers.amplitude[~upright].any()
    product = (scatterers.amplitude * distance**2)[upright]
    assert 150 < product.mean() < 250
    assert (jnp.abs(scatterers.velocity) < 1.5).all()


def test_radar_points_lie_where_the_lidar_sees_surfaces():
    frame = room_frame(jax.random.key(1), RADAR, IMAGE)
    cloud = radar_points(frame.cube, RADAR, capacity=16, false_alarm_rate=1e-6)
    ranges = np.linalg.norm(np.asarray(cloud.xyz)[np.asarray(cloud.valid)], axis=1)
    seen = np.asarray(frame.lidar)[np.asarray(frame.lidar) > 0]
    assert len(ranges) > 8
    assert ranges.min() > seen.min() - 0.3 and ranges.max() < seen.max() + 3


def test_a_frame_is_a_function_of_its_key():
    a, b = (room_frame(jax.random.key(7), RADAR, IMAGE) for _ in range(2))
    for one, other in zip(a, b, strict=True):
        np.testing.assert_array_equal(one, other)
    c = room_frame(jax.random.key(8), RADAR, IMAGE)
    assert jnp.abs(a.lidar - c.lidar).max() > 0.1
