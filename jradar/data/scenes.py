"""Simulated rooms, seen by a LiDAR and by a radar from the same place.

A room is a shell with boxes standing in it, turned about the vertical. The LiDAR image
holds the distance of the first wall or box in each pixel; floor and ceiling, which
preprocessing removes from real scans, are misses. The radar gets point scatterers from
the same surfaces: Rayleigh amplitudes falling with the square of the distance, and the
velocities of a moving platform. All of it is a pure function of a key.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float, Key

from jradar.radar import RadarSpec, Scatterers, simulate_cube
from jradar.range_image import ImageSpec, pixel_directions

NUM_BOXES = 4
NUM_SCATTERERS = 256
AMPLITUDE_AT_1_M = 200.0  # ADC counts of an average scatterer
NOISE_POWER = 100.0  # ADC counts squared of a sample


class Room(NamedTuple):
    """Corners of the shell and of the boxes in the room's frame, and its turn."""

    shell: Float[Array, "2 3"]  # lowest and highest corner; the sensor is at (0, 0, 0)
    boxes: Float[Array, "box 2 3"]
    yaw: Float[Array, ""]


class Frame(NamedTuple):
    """What both sensors see of a scene."""

    cube: Complex[Array, "tx rx chirp sample"]
    lidar: Float[Array, "row column"]  # metres, 0 for a miss


def random_room(key: Key[Array, ""]) -> Room:
    """A room around the sensor, with boxes in front of it."""
    shell_key, place_key, size_key, yaw_key = jax.random.split(key, 4)
    lowest = jnp.array([[-4.0, -5.0, -1.3], [4.0, 1.5, 0.8]])
    highest = jnp.array([[-1.0, -1.5, -0.8], [11.0, 5.0, 2.0]])
    shell = jax.random.uniform(shell_key, (2, 3), minval=lowest, maxval=highest)

    place = jax.random.uniform(
        place_key,
        (NUM_BOXES, 2),
        minval=jnp.array([1.5, -2.5]),
        maxval=jnp.array([8.0, 2.5]),
    )
    size = jax.random.uniform(
        size_key,
        (NUM_BOXES, 3),
        minval=jnp.array([0.2, 0.2, 0.6]),
        maxval=jnp.array([1.2, 1.2, 2.2]),
    )
    floor = jnp.full((NUM_BOXES, 1), shell[0, 2])
    low = jnp.concatenate([place, floor], -1)
    boxes = jnp.stack([low, low + size], 1)
    yaw = jax.random.uniform(yaw_key, minval=-0.5, maxval=0.5)
    return Room(shell, boxes, yaw)


def cast_rays(
    room: Room, directions: Float[Array, "*batch 3"]
) -> tuple[Float[Array, "*batch"], Bool[Array, "*batch"]]:
    """Distance to the first surface along unit vectors, and whether it is upright.

    Floor and ceiling are not upright. The slab method, for a sensor at the origin.
    """
    cos, sin = jnp.cos(room.yaw), jnp.sin(room.yaw)
    x, y, z = jnp.moveaxis(jnp.asarray(directions), -1, 0)
    ray = jnp.stack([cos * x - sin * y, sin * x + cos * y, z], -1)
    ray = jnp.where(jnp.abs(ray) < 1e-9, 1e-9, ray)

    exits = jnp.maximum(*(room.shell[side] / ray for side in (0, 1)))
    wall = exits.min(-1)
    sides = room.boxes / ray[..., None, None, :]
    enter, leave = sides.min(-2).max(-1), sides.max(-2).min(-1)
    box = jnp.where((enter < leave) & (enter > 0), enter, jnp.inf).min(-1)
    upright = (box < wall) | (exits.argmin(-1) < 2)
    return jnp.minimum(box, wall), upright


def room_scatterers(key: Key[Array, ""], room: Room) -> Scatterers:
    """Radar scatterers on what is upright in front of a moving platform."""
    place_key, amplitude_key, motion_key = jax.random.split(key, 3)
    limits = jnp.array([1.2, 0.45])
    angles = jax.random.uniform(
        place_key, (NUM_SCATTERERS, 2), minval=-limits, maxval=limits
    )
    azimuth, elevation = angles.T
    ground = jnp.cos(elevation)
    direction = jnp.stack(
        [ground * jnp.cos(azimuth), ground * jnp.sin(azimuth), jnp.sin(elevation)], -1
    )
    distance, upright = cast_rays(room, direction)
    rayleigh = jax.random.rayleigh(amplitude_key, 0.8, (NUM_SCATTERERS,))
    slow, fast = jnp.array([0.2, -0.4, -0.1]), jnp.array([1.2, 0.4, 0.1])
    platform = jax.random.uniform(motion_key, (3,), minval=slow, maxval=fast)
    return Scatterers(
        xyz=distance[:, None] * direction,
        velocity=-direction @ platform,
        amplitude=jnp.where(upright, AMPLITUDE_AT_1_M * rayleigh / distance**2, 0.0),
    )


@functools.partial(jax.jit, static_argnames=("radar", "image"))
def room_frame(key: Key[Array, ""], radar: RadarSpec, image: ImageSpec) -> Frame:
    """A random room as both sensors see it; `vmap` it over keys."""
    room_key, scatterer_key, noise_key = jax.random.split(key, 3)
    room = random_room(room_key)
    directions = jnp.asarray(pixel_directions(image).astype(np.float32))
    distance, upright = cast_rays(room, directions)
    seen = upright & (distance <= image.max_range_m)
    cube = simulate_cube(
        noise_key,
        room_scatterers(scatterer_key, room),
        radar,
        noise_power=NOISE_POWER,
    )
    return Frame(cube, jnp.where(seen, distance, 0.0))
