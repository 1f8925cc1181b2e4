"""A LiDAR in a room of boxes: a scan whose every point is known by its surface."""

import numpy as np

FLOOR, CEILING, WALL, BOX = 0, 1, 2, 3  # the first box; others follow
OS1_ELEVATION = np.radians(np.linspace(-16.6, 16.6, 64))


def scan_room(
    shell,
    boxes=(),
    *,
    elevation=OS1_ELEVATION,
    columns=1024,
    noise_m=0.02,
    tilt=(0.0, 0.0),
    seed=0,
):
    """float32 [point, 3] and the surface of each point; the sensor is at (0, 0, 0).

    `shell` and `boxes` are (lowest, highest) corners; z = 0 is the sensor's height.
    `tilt` rolls and pitches the sensor, in radians: the cloud is in its own frame.
    """
    azimuth = np.linspace(-np.pi, np.pi, columns, endpoint=False) + 1e-3
    up, left = (a.ravel() for a in np.meshgrid(elevation, azimuth, indexing="ij"))
    level = np.cos(up)
    rays = np.stack([level * np.cos(left), level * np.sin(left), np.sin(up)], -1)
    (sin_roll, sin_pitch), (cos_roll, cos_pitch) = np.sin(tilt), np.cos(tilt)
    roll = np.array([[1, 0, 0], [0, cos_roll, -sin_roll], [0, sin_roll, cos_roll]])
    pitch = np.array([[cos_pitch, 0, sin_pitch], [0, 1, 0], [-sin_pitch, 0, cos_pitch]])
    world = rays @ (roll @ pitch).T
    world[np.abs(world) < 1e-9] = 1e-9
    exits = np.maximum(*(np.asarray(corner) / world for corner in shell))
    distance, side = exits.min(-1), exits.argmin(-1)
    surface = np.where(side < 2, WALL, np.where(world[:, 2] < 0, FLOOR, CEILING))
    for number, box in enumerate(boxes):
        sides = np.stack([np.asarray(corner) / world for corner in box])
        enter, leave = sides.min(0).max(-1), sides.max(0).min(-1)
        hit = (enter < leave) & (enter > 0) & (enter < distance)
        distance[hit], surface[hit] = enter[hit], BOX + number
    distance += np.random.default_rng(seed).normal(0, noise_m, len(distance))
    return (distance[:, None] * rays).astype(np.float32), surface
