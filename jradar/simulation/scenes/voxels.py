"""Occupied voxels to surfaces: a map of a real place becomes a scene.

A normal is fitted to each voxel: the direction in which the nearest `NEIGHBOURS` voxels
spread least. Neighbours whose normals agree, and which lie in one another's plane, are
linked. A group of linked voxels is halved across its length until one plane fits. Such
a part becomes a flat face: its voxels are projected to the plane, and fill cells of a
grid there, with small holes closed. So walls are exactly flat, as they have to be to
mirror. Every other voxel becomes a triangle in its own plane.

          voxels          normals           a plane, and triangles
        # # # # #        | | | | /          ________  /
                #                -                   |

Voxels lie on a grid, so directions and distances are often tied, and processors round
linear algebra differently. A slight tilt breaks the ties, and numbers are rounded
before they are compared. So a seed gives the same scene on every machine.
"""

import numpy as np
from jaxtyping import Float, Int
from scipy import ndimage, sparse, spatial
from scipy.sparse import csgraph

from jradar.simulation.scenes.materials import MATERIAL_IDS
from jradar.simulation.scenes.solids import Solid, join

NEIGHBOURS = 20
ALIKE = np.cos(np.radians(20))  # of the normals of linked voxels
OFF_PLANE = 0.9  # voxels, between linked voxels along their normals
MOST_RMS = 0.65  # voxels, from a plane; walls of maps are up to two voxels thick
LEAST_VOXELS = 40  # of a plane
RADIUS = 1.1  # voxels, of the triangle of another voxel
BLOCK_M = 1.5  # in which other voxels share a material
LEVEL = 0.9  # |z| of the normal of a floor
LOW_M = 0.4  # up to which a level plane is a floor
TILT = 1e-3 * np.array([[1, 2, 5], [2, 3, 7], [5, 7, -4]])  # of spreads, in voxels^2
DECIMALS = 6  # of directions, and of places in voxels


def surfaces(
    random: np.random.Generator,
    centres: Float[np.ndarray, "voxel 3"],
    voxel_m: float,
    *,
    floors: tuple[str, ...],
    walls: tuple[str, ...],
    others: tuple[str, ...],
) -> Solid:
    """Return the surfaces of a map, whose floor is near z = 0.

    `floors`, `walls` and `others` are materials; each plane draws its own, and other
    voxels do so in blocks of `BLOCK_M`.
    """
    tree = spatial.KDTree(centres)
    _, near = tree.query(centres, k=min(NEIGHBOURS, len(centres)))
    normal, middle = _axes(centres[near], voxel_m)[:, 0], centres[near].mean(1)
    group = _groups(centres, normal, near, voxel_m)
    order = np.argsort(group, kind="stable")
    waiting = np.split(order, np.cumsum(np.bincount(group))[:-1])
    rough, parts = np.ones(len(centres), bool), []
    while waiting:
        members = waiting.pop()
        if len(members) < LEAST_VOXELS:
            continue
        mean, axes = centres[members].mean(0), _axes(centres[members], voxel_m)
        cell = ((centres[members] - mean) @ axes.T / voxel_m).round(DECIMALS)
        if (cell[:, 0] ** 2).mean() > MOST_RMS**2:
            waiting += [members[cell[:, 2] < 0], members[cell[:, 2] >= 0]]
            continue
        level = abs(axes[0, 2]) > LEVEL and mean[2] < LOW_M
        material = str(random.choice(floors if level else walls))
        parts.append(_plane(cell[:, 2:0:-1], mean, axes[2:0:-1], voxel_m, material))
        rough[members] = False
    if rough.any():
        height = ((centres - middle) * normal).sum(1)[:, None]
        foot = (centres - height * normal)[rough]
        parts.append(_triangles(random, foot, normal[rough], voxel_m, others))
    return join(parts)


def _axes(points, voxel_m) -> Float[np.ndarray, "*set 3 3"]:
    """Return unit vectors along the least to the largest spread of sets of points.

    The largest component of each is positive.
    """
    offset = (points - points.mean(-2, keepdims=True)) / voxel_m
    spread = np.swapaxes(offset, -1, -2) @ offset / points.shape[-2]
    vectors = np.linalg.eigh(spread + TILT).eigenvectors
    axes = np.swapaxes(vectors, -1, -2).round(DECIMALS)
    largest = np.abs(axes).argmax(-1, keepdims=True)
    return axes * np.sign(np.take_along_axis(axes, largest, -1))


def _groups(centres, normal, near, voxel_m) -> Int[np.ndarray, " voxel"]:
    """Return the number of each voxel's group of linked neighbours."""
    count = len(centres)
    first, second = np.repeat(np.arange(count), near.shape[1]), near.ravel()
    alike = np.abs((normal[first] * normal[second]).sum(1)) > ALIKE
    step = centres[second] - centres[first]
    off = np.abs((step * normal[first]).sum(1)) < OFF_PLANE * voxel_m
    touching = (step**2).sum(1) < 4.5 * voxel_m**2
    kept = alike & off & touching
    ones = np.ones(kept.sum(), bool)
    links = sparse.coo_array((ones, (first[kept], second[kept])), shape=(count, count))
    return csgraph.connected_components(links, directed=False)[1]


def _plane(cell, mean, sides, voxel_m, material) -> Solid:
    """Return the cells of a plane that hold voxels, as squares with shared corners."""
    cell = np.rint(cell).astype(int)
    cell -= (low := cell.min(0) - 2)
    full = np.zeros(cell.max(0) + 3, bool)
    full[tuple(cell.T)] = True
    full = ndimage.binary_closing(full, np.ones((3, 3)))
    shape = np.add(full.shape, 1)
    corner = np.arange(shape.prod()).reshape(shape)
    a, b = corner[:-1, :-1][full], corner[1:, :-1][full]
    c, d = corner[1:, 1:][full], corner[:-1, 1:][full]
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])
    used, faces = np.unique(faces, return_inverse=True)
    place = np.stack(np.unravel_index(used, corner.shape), -1)
    vertices = mean + (place + low - 0.5) * voxel_m @ sides
    faces = faces.reshape(-1, 3)
    return Solid(vertices, faces, np.full(len(faces), MATERIAL_IDS[material]))


def _triangles(random, foot, normal, voxel_m, materials) -> Solid:
    """Return a triangle about each place, across its normal."""
    helper = np.eye(3)[np.argmin(np.abs(normal), 1)]
    first = np.cross(normal, helper)
    first *= RADIUS * voxel_m / np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normal, first)
    turn = 2 * np.pi * np.arange(3) / 3
    corners = foot[:, None] + np.einsum(
        "ck,kvi->vci", np.stack([np.cos(turn), np.sin(turn)], -1), [first, second]
    )
    faces = np.arange(3 * len(foot)).reshape(-1, 3)
    block = np.floor(foot / BLOCK_M).astype(int)
    _, block = np.unique(block, axis=0, return_inverse=True)
    kinds = np.array([MATERIAL_IDS[name] for name in materials])
    drawn = kinds[random.integers(len(kinds), size=block.max() + 1)][block.ravel()]
    return Solid(corners.reshape(-1, 3), faces, drawn)
