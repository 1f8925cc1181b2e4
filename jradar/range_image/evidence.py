"""The radar's points next to a network's cloud: which pixels they support, and add.

A network completes surfaces from little: some of its pixels lie far from everything
that the radar measured. They may be the rest of a wall, or a wall that does not exist,
drawn around a single strong echo. So a pixel that is alone needs more confidence to be
kept (`near_echo`).

A network also leaves out what the radar has found, most of all far away. So each of the
radar's points adds a few points around it to the cloud (`surroundings`). Their
confidence depends on how many other points are near (`crowding`): points gather at a
surface, and a single one is as often noise.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jradar.compiled import jit
from jradar.range_image.grid import ImageSpec, pixel_of
from jradar.types import PointCloud

LEAST_SNR = 4.0  # of a point that stands out, 6 dB
CELLS = 48  # in the largest range
REACH = 2  # cells, to a side
AROUND = 10  # points for each point of the radar
WIDE = 1.5  # their deviation up and down, and to the sides, times what is near
DEEP = 0.5  # and along the line of sight
LEAST_M = 1e-3  # from the vertical axis: nearer, a point is straight overhead
CROWD = 1024.0  # points that make a crowding of 1


@jit(static_argnames="spec")
def near_echo(
    cloud: PointCloud, points: PointCloud, spec: ImageSpec
) -> Bool[Array, " point"]:
    """Return which points of a cloud lie near a radar point of 6 dB or more.

    Near is at most two cells away along each axis. A cell is 1/48 of the largest range,
    so that two cells are 0.5 m of 12. Without SNR all points of the radar count. Points
    that are not valid are not near anything. One cloud; `vmap` it.
    """
    loud = (
        points.valid if points.snr is None else points.valid & (points.snr >= LEAST_SNR)
    )
    return (count_near(cloud.xyz, points.xyz, loud, spec) > 0) & cloud.valid


@jit(static_argnames=("spec", "axes"))
def crowding(
    points: PointCloud, spec: ImageSpec, *, axes: int = 3
) -> Float[Array, " point"]:
    """Return how many points are near each point: 0 for itself alone, 1 for 1,024.

    The scale is logarithmic. Near is as in `near_echo`; with two axes, points above
    each other are near. One cloud; `vmap` it.
    """
    place = points.xyz[:, :axes]
    count = count_near(place, place, points.valid, spec)
    return jnp.clip(jnp.log(jnp.maximum(count, 1.0)) / np.log(CROWD), 0.0, 1.0)


@jit(static_argnames="spec")
def surroundings(points: PointCloud, spec: ImageSpec) -> PointCloud:
    """Return ten points around each point, in a disc across the line of sight.

    They have the velocity and confidence of their point, and are valid if both are in
    the field of view of `spec`. A surface that reflects to the radar mostly faces it,
    and continues to all sides. One cloud; `vmap` it.
    """
    steps = spec.near_m * _disc()
    return spread_out(points, steps, lambda xyz: pixel_of(xyz, spec)[-1])


def spread_out(
    points: PointCloud,
    steps: Float[np.ndarray, "step 3"],
    inside: Callable[[Float[Array, "*batch 3"]], Bool[Array, "*batch"]],
) -> PointCloud:
    """Return points at `steps` ahead, to the left and up (m) from each point.

    Ahead is along the line of sight. They have the velocity and confidence of their
    point, and are valid if both are `inside`. A point within 1 mm of the vertical axis
    has none. One cloud; `vmap` it.
    """
    usable = points.valid & ((points.xyz[:, :2] ** 2).sum(-1) > LEAST_M**2)
    xyz = jnp.where(usable[:, None], points.xyz, jnp.asarray((1.0, 0.0, 0.0)))
    ahead = xyz / jnp.linalg.norm(xyz, axis=-1, keepdims=True)
    ground = jnp.linalg.norm(ahead[:, :2], axis=-1, keepdims=True)
    left = jnp.concatenate([-ahead[:, 1:2], ahead[:, :1], 0 * ground], -1) / ground
    axes = jnp.stack([ahead, left, jnp.cross(ahead, left)], 1)
    around = xyz[:, None] + jnp.asarray(steps, xyz.dtype) @ axes
    valid = (inside(around) & (inside(xyz) & usable)[:, None]).ravel()
    velocity, confidence = points.velocity, points.confidence
    if velocity is not None:
        velocity = velocity.repeat(len(steps))
    if confidence is not None:
        confidence = jnp.where(valid, confidence.repeat(len(steps)), 0.0)
    return PointCloud(around.reshape(-1, 3), valid, velocity, confidence=confidence)


def _disc():
    """Steps [point, 3] ahead, to the left and up: a Gaussian, evenly sampled."""
    share = (np.arange(AROUND) + 0.5) / AROUND
    radius = WIDE * np.sqrt(-2 * np.log(1 - share))
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(AROUND)  # the golden angle
    deep = DEEP * np.where(np.arange(AROUND) % 2, 1, -1)
    return np.stack([deep, radius * np.cos(angle), radius * np.sin(angle)], -1)


def count_near(
    xyz: Float[Array, "*batch axis"],
    others: Float[Array, "other axis"],
    counted: Bool[Array, " other"],
    spec: ImageSpec,
) -> Float[Array, "*batch"]:
    """Return how many of the counted others are near each point; `near_echo` says how.

    Points have three coordinates, or the first two. Places beyond the largest range
    have none.
    """
    half = CELLS + 1
    size, axes = 2 * half, others.shape[-1]

    def cells(places):
        index = jnp.floor(places * (CELLS / spec.max_range_m)).astype(jnp.int32) + half
        inside = ((index >= 0) & (index < size)).all(-1)
        return tuple(jnp.moveaxis(jnp.clip(index, 0, size - 1), -1, 0)), inside

    place, inside = cells(others)
    counted = jnp.where(counted & inside, 1.0, 0.0)
    counts = jnp.zeros((size,) * axes).at[place].add(counted)
    for axis in range(axes):
        window = [1] * axes
        window[axis] = 2 * REACH + 1
        counts = jax.lax.reduce_window(
            counts, 0.0, jax.lax.add, tuple(window), (1,) * axes, "SAME"
        )
    place, inside = cells(xyz)
    return jnp.where(inside, counts[place], 0.0)
