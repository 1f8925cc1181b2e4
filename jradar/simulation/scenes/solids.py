"""Solids and sheets of triangles, each face with its material.

Metres, z up. `join` makes one solid of several. A sheet is a single layer of faces;
both of its sides count.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import trimesh
from jaxtyping import Float, Int

from jradar.simulation.scenes.materials import MATERIAL_IDS

Numbers = Sequence[Any] | np.ndarray  # floats or integers


class Solid(NamedTuple):
    """Triangles and their materials."""

    vertices: Float[np.ndarray, "vertex 3"]
    faces: Int[np.ndarray, "face 3"]
    material: Int[np.ndarray, " face"]  # index into MATERIALS


def join(solids: list[Solid]) -> Solid:
    """Return one solid made of several."""
    first = np.cumsum([0, *(len(solid.vertices) for solid in solids)])
    return Solid(
        np.concatenate([solid.vertices for solid in solids]),
        np.concatenate([s.faces + o for s, o in zip(solids, first, strict=False)]),
        np.concatenate([solid.material for solid in solids]),
    )


def moved(solid: Solid, xyz: Numbers, *, yaw: float = 0.0) -> Solid:
    """Return the solid rotated about the vertical, then shifted."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    return solid._replace(vertices=solid.vertices @ turn.T + np.array(xyz, float))


def of_mesh(mesh: trimesh.Trimesh, material: str) -> Solid:
    """Return a mesh of one material as a solid."""
    faces = np.asarray(mesh.faces, np.int64)
    return Solid(np.asarray(mesh.vertices, float), faces, _fill(material, len(faces)))


def sheet(corners: Numbers, material: str) -> Solid:
    """Return a flat convex polygon."""
    faces = np.array([[0, k, k + 1] for k in range(1, len(corners) - 1)])
    return Solid(np.array(corners, float), faces, _fill(material, len(faces)))


def box(size: Numbers, material: str) -> Solid:
    """Return a box that stands on z = 0, centred in x and y."""
    mesh = trimesh.creation.box(size)
    mesh.apply_translation([0, 0, size[2] / 2])
    return of_mesh(mesh, material)


def boxes(material: str, *rows: tuple[Numbers, Numbers]) -> list[Solid]:
    """Return boxes of one material, each of a size and standing at x, y and z."""
    return [moved(box(size, material), xyz) for size, xyz in rows]


def posts(
    size: Numbers, material: str, xs: Numbers, ys: Numbers, *, z: float = 0.0
) -> list[Solid]:
    """Return boxes that stand at every x and y, on `z`."""
    return [moved(box(size, material), (x, y, z)) for x in xs for y in ys]


def pole(radius: float, height: float, material: str, *, sides: int = 12) -> Solid:
    """Return an upright cylinder that stands on z = 0."""
    mesh = trimesh.creation.cylinder(radius, height, sections=sides)
    mesh.apply_translation([0, 0, height / 2])
    return of_mesh(mesh, material)


def pipe(start: Numbers, end: Numbers, radius: float, *, sides: int = 12) -> Solid:
    """Return a cylinder of metal from a point to another."""
    segment = np.array([start, end], float)
    mesh = trimesh.creation.cylinder(radius, segment=segment, sections=sides)
    return of_mesh(mesh, "metal")


def wall(
    start: Numbers,
    end: Numbers,
    height: float,
    material: str,
    *,
    openings: Numbers = (),
) -> Solid:
    """Return an upright wall; doors and windows are set back by 8 cm to its left.

    An opening is (start in metres, width, kind). "wood" and "metal" are doors 2.1 m
    high, "glass" is a window from 0.9 m to 2.2 m, "open" is a passage, and "column" a
    ledge of metal that stands out.
    """
    along = np.subtract(end, start)
    length = float(np.hypot(*along))
    yaw = float(np.arctan2(along[1], along[0]))
    parts, at = [], 0.0

    def panel(x0, x1, z0, z1, kind, depth=0.0):
        corners = [(x0, depth, z0), (x1, depth, z0), (x1, depth, z1), (x0, depth, z1)]
        if x1 - x0 > 1e-3 and z1 - z0 > 1e-3:
            parts.append(sheet(corners, kind))

    for begin, width, kind in sorted(openings):
        stop = begin + width
        panel(at, begin, 0, height, material)
        at = stop
        if kind == "column":
            ledge = box((width, 0.16, height), "metal")
            parts.append(moved(ledge, (begin + width / 2, 0, 0)))
            continue
        low, high = (0.9, 2.2) if kind == "glass" else (0.0, 2.1)
        high = min(high, height - 0.1)
        panel(begin, stop, high, height, material)
        panel(begin, stop, 0, low, material)
        if kind != "open":
            panel(begin, stop, low, high, kind, 0.08)
        for x in (begin, stop):
            jamb = [(x, 0, low), (x, 0.08, low), (x, 0.08, high), (x, 0, high)]
            parts.append(sheet(jamb, "metal" if kind != "glass" else material))
    panel(at, length, 0, height, material)
    return moved(join(parts), (*start, 0.0), yaw=yaw)


def slab(low: Numbers, high: Numbers, z: float, material: str) -> Solid:
    """Return a level rectangle: a floor or a ceiling."""
    (x0, y0), (x1, y1) = low, high
    return sheet([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)], material)


def person(height: float) -> Solid:
    """Return a standing person: legs, trunk, arms and head of about 1,000 faces."""
    parts = [
        _capsule(0.08, 0.70, (0, 0.1, 0.08)),
        _capsule(0.08, 0.70, (0, -0.1, 0.08)),
        _capsule(0.17, 0.45, (0, 0, 0.90)),
        _capsule(0.05, 0.50, (0, 0.25, 0.85)),
        _capsule(0.05, 0.50, (0, -0.25, 0.85)),
        _capsule(0.10, 0.08, (0, 0, 1.60)),
    ]
    solid = join(parts)
    return solid._replace(vertices=solid.vertices * (height / 1.75))


def car(length: float) -> Solid:
    """Return a car on z = 0 that faces x: body, cabin of glass, roof, wheels."""
    height, width, inner = 1.45, 0.88, 0.8 * 0.88
    waist = 0.55 * height
    body = box((length, 2 * width, waist - 0.25), "metal")
    tail, hood, back, front = np.array(  # corners of the cabin on the left side
        [
            (-0.38 * length, width, waist),
            (0.22 * length, width, waist),
            (-0.28 * length, inner, height),
            (0.05 * length, inner, height),
        ]
    )

    def across(low, high, material):
        mirror = np.array([1, -1, 1])
        return sheet([low * mirror, high * mirror, high, low], material)

    parts = [
        moved(body, (0, 0, 0.25)),
        across(back, front, "metal"),
        across(hood, front, "glass"),
        across(tail, back, "glass"),
    ]
    for side in (-1, 1):
        pane = np.array([tail, hood, front, back]) * [1, side, 1]
        parts.append(sheet(pane, "glass"))
        for x in (-0.32 * length, 0.32 * length):
            wheel = trimesh.creation.cylinder(0.31, 0.2, sections=14)
            upright = trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0])
            wheel.apply_transform(upright)
            wheel.apply_translation([x, side * (width - 0.05), 0.31])
            parts.append(of_mesh(wheel, "plastic"))
    return join(parts)


def tree(random: np.random.Generator, height: float) -> Solid:
    """Return a tree: a trunk, and a crown of leaves with random directions."""
    trunk = pole(0.12 + 0.02 * random.random(), 0.6 * height, "wood", sides=10)
    count = 220
    centre = random.normal(size=(count, 3)) * [0.11, 0.11, 0.13] * height
    centre += [0, 0, 0.7 * height]
    across = random.normal(size=(2, count, 3)) * 0.16
    corners = np.stack([centre, centre + across[0], centre + across[1]], 1)
    faces = np.arange(3 * count).reshape(-1, 3)
    leaves = Solid(corners.reshape(-1, 3), faces, _fill("foliage", count))
    return join([trunk, leaves])


def boulder(random: np.random.Generator, size: float, material: str) -> Solid:
    """Return a rough lump that lies on z = 0."""
    mesh = trimesh.creation.icosphere(subdivisions=2)
    bumps = random.normal(size=(6, 3)) * 2.0
    phase = random.uniform(0, 2 * np.pi, 6)
    swell = np.sin(mesh.vertices @ bumps.T + phase).sum(-1)
    vertices = mesh.vertices * (1 + 0.08 * swell)[:, None] * [size, size, 0.6 * size]
    vertices[:, 2] += 0.3 * size
    return Solid(vertices, np.asarray(mesh.faces), _fill(material, len(mesh.faces)))


def _capsule(radius, height, xyz):
    """Return an upright capsule of a person."""
    mesh = trimesh.creation.capsule(height, radius, count=[8, 12])
    mesh.apply_translation([xyz[0], xyz[1], xyz[2] - mesh.bounds[0, 2]])
    return of_mesh(mesh, "person")


def _fill(material, count):
    return np.full(count, MATERIAL_IDS[material])
