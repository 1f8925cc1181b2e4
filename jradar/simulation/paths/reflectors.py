"""Flat faces, right-angled edges and corners of a scene, which reflect like mirrors.

Two flat faces at right angles that face each other form an edge, three form a corner:
the wave returns after two or three reflections, from the image of the radar behind the
edge or the corner. Edges and corners are searched in the world only, once.
"""

import itertools
from typing import NamedTuple

import numpy as np
import trimesh
from jaxtyping import Float, Int

from jradar.simulation.scenes.scene import Body

LEAST_SIDE_M = 0.15  # of a flat face
RIGHT_ANGLE = 0.02  # cosine up to which two faces count as perpendicular
TOUCH_M = 0.02  # gap over which they count as joined
LEAST_EDGE_M = 0.15


class Facets(NamedTuple):
    """Flat faces, in the body's frame."""

    centre: Float[np.ndarray, "facet 3"]
    normal: Float[np.ndarray, "facet 3"]
    area_m2: Float[np.ndarray, " facet"]
    material: Int[np.ndarray, " facet"]


class Edges(NamedTuple):
    """Concave right angles; `inward` points from each face towards the other."""

    start: Float[np.ndarray, "edge 3"]
    along: Float[np.ndarray, "edge 3"]  # unit vector
    length_m: Float[np.ndarray, " edge"]
    inward: Float[np.ndarray, "edge 2 3"]
    material: Int[np.ndarray, "edge 2"]
    width_m: Float[np.ndarray, " edge"]  # of the smaller face
    facets: Int[np.ndarray, "edge 2"]


class Corners(NamedTuple):
    """Points where three faces meet at right angles."""

    xyz: Float[np.ndarray, "corner 3"]
    inward: Float[np.ndarray, "corner 3 3"]
    material: Int[np.ndarray, "corner 3"]
    side_m: Float[np.ndarray, " corner"]


class Reflectors(NamedTuple):
    """Facets of each body of a scene; edges and corners of the world."""

    facets: tuple[Facets, ...]
    edges: Edges
    corners: Corners


def find_reflectors(bodies: tuple[Body, ...]) -> Reflectors:
    """Return the reflectors of a scene's bodies, of which the first is the world."""
    found = [_facets(body) for body in bodies]
    edges, facets = _edges(*found[0]), tuple(facets for facets, _ in found)
    return Reflectors(facets, edges, _corners(facets[0], edges))


def _facets(body: Body) -> tuple[Facets, list[np.ndarray]]:
    """Return the larger flat faces, and the vertices of each."""
    solid = body.solid
    mesh = trimesh.Trimesh(solid.vertices, solid.faces, process=False)
    rows, outlines = [], []
    large = np.asarray(mesh.facets_area) > LEAST_SIDE_M**2
    for faces in (f for f, keep in zip(mesh.facets, large, strict=True) if keep):
        normal = body.normals[faces[0]].astype(float)
        points = np.unique(solid.vertices[solid.faces[faces]].reshape(-1, 3), axis=0)
        sides = np.linalg.svd(points - points.mean(0), full_matrices=False)[2][:2]
        extent = np.ptp(points @ sides.T, axis=0)
        if extent.min() < LEAST_SIDE_M:
            continue
        area = float(mesh.area_faces[faces].sum())
        rows.append((points.mean(0), normal, area, solid.material[faces[0]]))
        outlines.append(points)
    example = (np.zeros(3), np.zeros(3), 0.0, 0)
    return Facets(*_columns(rows, example)), outlines


def _columns(rows, example):
    """Return columns of rows as arrays; `example` is a row that gives their shapes."""
    columns = zip(*(rows or [example]), strict=True)
    return [np.array(column)[: len(rows)] for column in columns]


def _edges(facets: Facets, outlines: list[np.ndarray]) -> Edges:
    """Return the concave edges between perpendicular facets that touch."""
    rows = []
    low = np.array([outline.min(0) for outline in outlines]).reshape(-1, 3) - TOUCH_M
    high = np.array([outline.max(0) for outline in outlines]).reshape(-1, 3) + TOUCH_M
    for i in range(len(outlines)):
        upright = np.abs(facets.normal @ facets.normal[i]) < RIGHT_ANGLE
        touching = ((low < high[i]) & (high > low[i])).all(1)
        touching[: i + 1] = False
        for j in np.flatnonzero(upright & touching):
            rows += _edges_of_pair(facets, outlines, i, j)
    pair, point = np.zeros(2, int), np.zeros(3)
    example = (point, point, 0.0, np.zeros((2, 3)), pair, 0.0, pair)
    return Edges(*_columns(rows, example))


def _edges_of_pair(facets, outlines, i, j):
    """Yield the edges of two perpendicular facets, one for each pair of sides."""
    heights = [
        (outlines[a] - facets.centre[b]) @ facets.normal[b] for a, b in ((i, j), (j, i))
    ]
    ranges = [(height.min(), height.max()) for height in heights]
    along = np.cross(facets.normal[i], facets.normal[j])
    along /= np.linalg.norm(along)
    pair = np.array([i, j])
    normals = facets.normal[pair]
    reach = [(facets.centre[f] * facets.normal[f]).sum() for f in pair]
    # On which side of plane j facet i lies, and the other way round.
    for signs in itertools.product((-1, 1), repeat=2):
        spans = [
            sorted((s * a, s * b)) for s, (a, b) in zip(signs, ranges, strict=True)
        ]
        if any(high <= 0.1 or low >= TOUCH_M for low, high in spans):
            continue
        side_of_j, side_of_i = signs
        sided = (side_of_j * heights[0], side_of_i * heights[1])
        first = _crossing(outlines[i], sided[0], along)
        second = _crossing(outlines[j], sided[1], along)
        if first is None or second is None:
            continue
        low, high = max(first[0], second[0]), min(first[1], second[1])
        if high - low < LEAST_EDGE_M:
            continue
        base = normals.T @ reach + along * low
        inward = np.stack([side_of_i * normals[0], side_of_j * normals[1]])
        width = min(height.max() for height in sided)
        yield base, along, high - low, inward, facets.material[pair], width, pair


def _crossing(outline, height, along):
    """Return the stretch of a facet along an edge, just inside it, or None."""
    at, inside = outline @ along, height > TOUCH_M
    if inside.all():
        return None
    (low, high), far = (at[inside], at[~inside]), height[~inside]
    ends = low[:, None] + (high - low[:, None]) * (
        TOUCH_M - height[inside][:, None]
    ) / (far - height[inside][:, None])
    return (ends.min(), ends.max()) if ends.size else None


def _corners(facets: Facets, edges: Edges) -> Corners:
    """Return the places where an edge ends on a facet at which two more edges begin."""
    rows = []
    edges_of = [
        np.flatnonzero((edges.facets == f).any(1)) for f in range(len(facets.centre))
    ]
    across = np.abs(np.abs(edges.along @ facets.normal.T) - 1) < RIGHT_ANGLE
    at = edges.along @ facets.centre.T - (edges.along * edges.start).sum(1)[:, None]
    for end, sign in ((np.zeros(len(at)), 1.0), (edges.length_m, -1.0)):
        ends = across & (np.abs(at - end[:, None]) < 2 * TOUCH_M)
        for f in np.flatnonzero(ends.any(0)):
            k = np.flatnonzero(ends[:, f])
            xyz = edges.start[k] + at[k, f, None] * edges.along[k]
            ends[k, f] = _joined(edges, edges_of[f], xyz, edges.facets[k])
        for k, f in np.argwhere(ends):
            xyz = edges.start[k] + at[k, f] * edges.along[k]
            inward = [*edges.inward[k], sign * edges.along[k]]
            material = [*edges.material[k], facets.material[f]]
            side = min(edges.length_m[k], edges.width_m[k])
            rows.append((xyz, np.array(inward), np.array(material), side))
    example = (np.zeros(3), np.zeros((3, 3)), np.zeros(3, int), 0.0)
    corners = Corners(*_columns(rows, example))
    # Each corner is found three times: from each of its edges.
    inside = corners.xyz + 0.1 * corners.inward.sum(1)
    _, first = np.unique(np.round(inside, 1), axis=0, return_index=True)
    return Corners(*(column[np.sort(first)] for column in corners))


def _joined(edges, some, xyz, pairs):
    """Return whether, at each point, `some` edges belong to both facets of its pair."""
    offset = xyz[:, None] - edges.start[some]
    along = (offset * edges.along[some]).sum(-1)
    near = (along > -2 * TOUCH_M) & (along < edges.length_m[some] + 2 * TOUCH_M)
    aside = offset - along[..., None] * edges.along[some]
    near &= (aside**2).sum(-1) < (2 * TOUCH_M) ** 2
    belongs = (edges.facets[some][:, :, None] == pairs[:, None, None, :]).any(2)
    return (near[..., None] & belongs).any(1).all(1)
