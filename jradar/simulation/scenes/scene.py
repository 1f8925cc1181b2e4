"""A scene of rigid bodies, and rays cast through it at any time.

Body 0 is the world, which stands still. Each body has a search tree in its own frame,
built once; rays are transformed to the frames of bodies that they come near. For the
radar each body also carries points spread over its surface. The reflectivity of a point
is complex Gaussian: the speckle of details smaller than a range bin. A point keeps its
reflectivity from frame to frame.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jradar.errors import optional
from jradar.simulation.scenes.materials import MATERIALS
from jradar.simulation.scenes.solids import Solid
from jradar.simulation.scenes.trajectory import Trajectory, pose_at, velocity_at

NUDGE_M = 1e-3  # by which a ray starts behind a surface
ROOM_M = 0.6  # around the sensors' axis, into which nobody walks
FAR_BELOW_M = 1000.0


class Body(NamedTuple):
    """A rigid body in its own frame."""

    solid: Solid
    normals: Float[np.ndarray, "face 3"]
    tree: Any  # embree's scene
    radius_m: float  # of the enclosing sphere about the frame's origin
    trajectory: Trajectory | None  # None: it stands still
    points: Float[np.ndarray, "point 3"]
    point_face: Int[np.ndarray, " point"]
    reflectivity: Float[np.ndarray, " point"]  # magnitude, of mean square 1
    area_m2: Float[np.ndarray, " point"]


class Scene(NamedTuple):
    """The world, the bodies that move in it, and the trajectory of the sensors."""

    name: str
    bodies: tuple[Body, ...]
    platform: Trajectory


class Hits(NamedTuple):
    """First surfaces along rays; the distance is infinite where a ray meets none."""

    distance: Float[np.ndarray, " ray"]
    body: Int[np.ndarray, " ray"]
    material: Int[np.ndarray, " ray"]
    cosine: Float[np.ndarray, " ray"]  # of the angle to the normal, 0 to 1


class Placement(NamedTuple):
    """Place and velocity of a body at one time."""

    xyz: Float[np.ndarray, " 3"]
    turn: Float[np.ndarray, "3 3"]  # from the body's frame to the world's
    velocity: Float[np.ndarray, " 3"]
    spin: Float[np.ndarray, " 3"]  # angular velocity, rad/s in the world


def make_body(
    random: np.random.Generator, solid: Solid, *, trajectory: Trajectory | None = None
) -> Body:
    """Return a body made of a solid, with random scatterers."""
    corners = solid.vertices[solid.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double_area = np.linalg.norm(across, axis=-1)
    normals = across / np.maximum(double_area, 1e-12)[:, None]
    density = np.array([material.points_per_m2 for material in MATERIALS])
    expected = density[solid.material] * double_area / 2
    count = random.poisson(expected.sum())
    drawn = random.uniform(0, expected.sum(), count)
    face = np.searchsorted(np.cumsum(expected), drawn).clip(max=len(expected) - 1)
    u, v = random.random((2, count))
    u, v = np.where(u + v > 1, (1 - u, 1 - v), (u, v))
    a, b, c = np.moveaxis(corners[face], 1, 0)
    return Body(
        solid=solid,
        normals=normals.astype(np.float32),
        tree=_tree(solid),
        radius_m=float(np.linalg.norm(solid.vertices, axis=-1).max()),
        trajectory=trajectory,
        points=a + u[:, None] * (b - a) + v[:, None] * (c - a),
        point_face=face,
        reflectivity=np.sqrt(random.exponential(size=count)),
        area_m2=1 / density[solid.material[face]],
    )


def placements(scene: Scene, time_s: float) -> list[Placement]:
    """Return the placement of every body at a time.

    A person who would walk through the sensors is out of sight, far below.
    """
    still = Placement(np.zeros(3), np.eye(3), np.zeros(3), np.zeros(3))
    sensors, _ = pose_at(scene.platform, float(time_s))
    found = []
    for body in scene.bodies:
        if body.trajectory is None:
            found.append(still)
            continue
        xyz, turn = pose_at(body.trajectory, float(time_s))
        moving = velocity_at(body.trajectory, float(time_s))
        if np.linalg.norm((xyz - sensors)[:2]) < ROOM_M:
            xyz = xyz - [0.0, 0.0, FAR_BELOW_M]
        found.append(Placement(xyz, turn, *moving))
    return found


def cast(
    scene: Scene,
    places: list[Placement],
    origins: Float[np.ndarray, "ray 3"],
    directions: Float[np.ndarray, "ray 3"],
) -> Hits:
    """Return the first surfaces along rays (unit directions) in the world's frame."""
    origins = np.ascontiguousarray(origins, np.float32)
    directions = np.ascontiguousarray(directions, np.float32)
    world, *movers = scene.bodies
    found = world.tree.run(origins, directions, output=1)
    face = found["primID"]
    missed = face < 0
    distance = np.where(missed, np.float32(np.inf), found["tfar"])
    body = np.where(missed, -1, 0)
    cosine = np.abs(np.einsum("rc,rc->r", directions, world.normals[face]))
    material = world.solid.material[face]
    for index, (mover, place) in enumerate(zip(movers, places[1:], strict=True), 1):
        near = _near(mover, place, origins, directions, distance)
        if not near.size:
            continue
        turn = place.turn.astype(np.float32)
        start = (origins[near] - place.xyz.astype(np.float32)) @ turn
        along = directions[near] @ turn
        found = mover.tree.run(start, along, output=1)
        hit = (found["primID"] >= 0) & (found["tfar"] < distance[near])
        ray, its = near[hit], found["primID"][hit]
        distance[ray], body[ray] = found["tfar"][hit], index
        material[ray] = mover.solid.material[its]
        cosine[ray] = np.abs(np.einsum("rc,rc->r", along[hit], mover.normals[its]))
    return Hits(distance, body, np.where(body < 0, -1, material), cosine)


def _near(body, place, origins, directions, reach_m):
    """Return the indices of the rays that cross a body's sphere before they end."""
    towards = place.xyz.astype(np.float32) - origins
    along = np.einsum("rc,rc->r", towards, directions)
    aside = np.einsum("rc,rc->r", towards, towards) - along**2
    near = (aside < body.radius_m**2) & (along > -body.radius_m)
    return np.flatnonzero(near & (along - body.radius_m < reach_m))


def _tree(solid):
    core, meshes = (
        optional(f"embreex.{name}", need="simulation needs embreex", extra="sim")
        for name in ("rtcore_scene", "mesh_construction")
    )
    tree = core.EmbreeScene()
    meshes.TriangleMesh(tree, solid.vertices.astype("f4"), solid.faces.astype("i4"))
    return tree
