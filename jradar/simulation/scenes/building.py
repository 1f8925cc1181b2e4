"""Parts of buildings that kinds of scenes share: walls, shells, lamps, walkers."""

from collections.abc import Sequence

import numpy as np

from jradar.simulation.scenes.scene import Body, make_body
from jradar.simulation.scenes.solids import (
    Numbers,
    Solid,
    box,
    moved,
    person,
    sheet,
    slab,
    wall,
)
from jradar.simulation.scenes.trajectory import walk

Number = int | float


def rectangle(low: Numbers, high: Numbers) -> np.ndarray:
    """Return the corners `[corner, 2]` of a rectangle in turn, along x first."""
    (x0, y0), (x1, y1) = np.asarray(low), np.asarray(high)
    return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], float)


def ring(length: Number, depth: Number, *, offset: Number = 0.0) -> np.ndarray:
    """Return the corners of a rectangle from (0, 0), moved by `offset`."""
    return rectangle((0, 0), (length, depth)) + offset


def sides(corners: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the start and end of each side of a closed line."""
    return [*zip(corners, np.roll(corners, -1, 0), strict=True)]


def glass_front(x0: Number, x1: Number, y: Number, height: Number) -> Solid:
    """Return a pane of glass along x."""
    corners = [(x0, y, 0.1), (x1, y, 0.1), (x1, y, height), (x0, y, height)]
    return sheet(corners, "glass")


def wall_with_openings(
    random: np.random.Generator,
    start: Numbers,
    end: Numbers,
    height: Number,
    material: str,
    kinds: Sequence[str],
) -> Solid:
    """Return a wall with an opening of one of these kinds every few metres."""
    length = float(np.hypot(*np.subtract(end, start)))
    openings, at = [], random.uniform(0.8, 2.0)
    while at < length - 1.8:
        kind = str(random.choice(kinds))
        wide = {"glass": 1.6, "column": 0.3}.get(kind, 0.95)
        openings.append((at, wide, kind))
        at += wide + random.uniform(1.2, 3.5)
    return wall(start, end, height, material, openings=openings)


def floor_and_ceiling(
    length: Number, depth: Number, height: Number, *, margin: Number = 0.2
) -> list[Solid]:
    """Return floor and ceiling of rooms from (0, 0), larger by a margin."""
    low, high = (-margin, -margin), (length + margin, depth + margin)
    return [slab(low, high, 0.0, "floor"), slab(low, high, height, "ceiling")]


def shell(
    random: np.random.Generator,
    length: Number,
    depth: Number,
    height: Number,
    material: str,
    kinds: Sequence[str],
) -> list[Solid]:
    """Return floor, ceiling and four walls."""
    parts = floor_and_ceiling(length, depth, height)
    for a, b in sides(ring(length, depth)):
        parts.append(wall_with_openings(random, b, a, height, material, kinds))
    return parts


def beside_wall(
    random: np.random.Generator,
    side: tuple[np.ndarray, np.ndarray],
    gap: Number,
    item: Solid,
) -> Solid:
    """Return an item placed at the wall of one side of a room."""
    a, b = side
    along = (b - a) / np.linalg.norm(b - a)
    inward = np.array([-along[1], along[0]])
    spot = a + (b - a) * random.uniform(0.12, 0.88) + gap * inward
    return moved(item, (*spot, 0), yaw=float(np.arctan2(along[1], along[0])))


def lamps(random: np.random.Generator, line: np.ndarray, height: Number) -> list[Solid]:
    """Return lamps below the ceiling along a closed line."""
    lamps, every = [], random.uniform(2.5, 4.0)
    for a, b in sides(line):
        length = float(np.linalg.norm(b - a))
        for at in np.arange(1.0, length, every):
            spot = (*(a + (b - a) * at / length), height - 0.08)
            lamps.append(moved(box((0.6, 0.3, 0.07), "metal"), spot))
    return lamps


def walker(random: np.random.Generator, way: np.ndarray) -> Body:
    """Return a person who walks along a closed path."""
    ground = np.column_stack([way, np.zeros(len(way))])
    trajectory = walk(random, ground, speed_mps=random.uniform(0.7, 1.5))
    return make_body(random, person(random.uniform(1.55, 1.95)), trajectory=trajectory)
