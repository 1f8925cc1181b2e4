"""Procedural scenes that resemble ColoRadar's places, each a function of a seed.

hallways   a ring of corridors with doors, columns, lockers, rooms behind drywall
mine       a winding tunnel with rough rock walls, timber and pipes
lab        a hall with shelves, tables, chairs, and people walking about
outdoor    a yard among buildings: trees, poles, parked and moving cars
corridor   one long corridor with a glass front
hall       a high entrance hall with columns, glass and people
home       furnished rooms of a flat, joined by open doors (`interiors`)
warehouse  aisles between racks of goods (`interiors`)
plantroom  boilers, tanks, pumps and pipes (`interiors`)
forest     a clearing among trees, bushes and rocks

The `kinds` are families, too.
"""

import functools
from collections.abc import Callable

import numpy as np

from jradar.errors import UsageError
from jradar.simulation.scenes.building import (
    beside_wall,
    floor_and_ceiling,
    glass_front,
    lamps,
    rectangle,
    ring,
    shell,
    sides,
    walker,
    wall_with_openings,
)
from jradar.simulation.scenes.furniture import (
    bench,
    cabinet,
    chair,
    hall_item,
    pick,
    shelf,
    table,
)
from jradar.simulation.scenes.interiors import home, plantroom, warehouse
from jradar.simulation.scenes.kinds import KINDS, TUNNEL, Layout, make_layout
from jradar.simulation.scenes.scene import Scene, make_body
from jradar.simulation.scenes.solids import (
    boulder,
    box,
    car,
    join,
    moved,
    person,
    pole,
    slab,
    tree,
    wall,
)
from jradar.simulation.scenes.trajectory import walk
from jradar.simulation.scenes.tunnel import tunnel

EYE_M = 1.2  # height at which the rig is carried
INDOORS = ["wood", "metal", "column"]  # along inner walls


def make_scene(family: str, seed: int) -> Scene:
    """Return the scene of a family and a seed, the same on every machine."""
    if family not in FAMILIES:
        raise UsageError(f"scene {family!r}, expected one of {', '.join(FAMILIES)}")
    random = np.random.default_rng([seed, *family.encode()])
    statics, movers, way, speed = FAMILIES[family](random)
    world = make_body(random, join(statics))
    at_eye = np.column_stack([way, np.full(len(way), random.uniform(-0.15, 0.15))])
    at_eye[:, 2] += EYE_M
    platform = walk(random, at_eye, speed_mps=speed, rounding_m=0.7, hand_held=True)
    return Scene(f"{family}_{seed}", (world, *movers), platform)


def hallways(random: np.random.Generator) -> Layout:
    """Return a ring of corridors, with furnished rooms behind the drywall."""
    length, depth = random.uniform(16, 26), random.uniform(9, 16)
    width, height = random.uniform(1.9, 2.8), random.uniform(2.4, 3.0)
    outer = ring(length, depth)
    inner = ring(length - 2 * width, depth - 2 * width, offset=width)
    back = ring(length + 7, depth + 7, offset=-3.5)
    parts = floor_and_ceiling(length, depth, height, margin=4)
    kinds = ["wood", "metal", "wood", "column", "glass"]
    for (a, b), (c, d), (e, f) in zip(*map(sides, (outer, inner, back)), strict=True):
        parts.append(wall_with_openings(random, b, a, height, "drywall", kinds))
        parts.append(wall_with_openings(random, c, d, height, "drywall", INDOORS))
        parts.append(wall(f, e, height, "concrete"))
    for _ in range(random.integers(6, 11)):  # along the walls of the corridors
        side = sides(outer)[random.integers(4)]
        parts.append(beside_wall(random, side, 0.28, hall_item(random)))
    for _ in range(8):  # behind the drywall: only the radar sees them
        x = random.uniform(width + 0.6, length - width - 0.6)
        y = random.uniform(width + 0.6, depth - width - 0.6)
        item = cabinet(random)
        parts.append(moved(item, (x, y, 0), yaw=random.integers(4) * np.pi / 2))
    middle = ring(length - width, depth - width, offset=width / 2)
    parts += lamps(random, middle, height)
    movers = [walker(random, middle + random.uniform(-0.4, 0.4)) for _ in range(2)]
    way = middle if random.random() < 0.5 else middle[::-1]
    return parts, movers, way, random.uniform(0.8, 1.2)


def mine(random: np.random.Generator) -> Layout:
    """Return a closed drift through rock."""
    rock, middle = tunnel(random)
    parts = [rock]
    step = len(middle) // 14
    for k in range(0, len(middle), step):
        here, there = middle[k], middle[(k + 1) % len(middle)]
        yaw = float(np.arctan2(*(there - here)[::-1]))
        side = random.choice([-1, 1])
        aside = np.array([-np.sin(yaw), np.cos(yaw)]) * side * random.uniform(1.1, 1.4)
        spot = (*(here + aside), 0.0)
        draw = random.random()
        if draw < 0.35:
            parts.append(moved(boulder(random, random.uniform(0.2, 0.5), "rock"), spot))
        elif draw < 0.65:
            parts.append(moved(box((0.2, 0.2, 2.1), "wood"), spot, yaw=yaw))
        elif draw < 0.85:
            parts.append(moved(pole(0.08, 2.0, "metal"), spot))
        else:
            parts.append(moved(box((1.2, 0.7, 0.9), "metal"), spot, yaw=yaw))
    movers = [walker(random, middle[:: len(middle) // 12])]
    return parts, movers, middle[:: len(middle) // 24], random.uniform(0.7, 1.1)


def lab(random: np.random.Generator) -> Layout:
    """Return a furnished hall."""
    length, depth = random.uniform(10, 15), random.uniform(8, 11)
    height = random.uniform(2.8, 4.0)
    parts = shell(random, length, depth, height, "drywall", ["glass", "wood", "metal"])
    parts += [
        moved(box((0.4, 0.4, height), "concrete"), (length * f, depth / 2, 0))
        for f in (0.33, 0.66)
    ]
    lane = 1.7  # in which people walk, along the furniture of the walls
    for _ in range(random.integers(9, 14)):
        x = random.uniform(lane + 1, length - lane - 1)
        y = random.uniform(lane + 0.8, depth - lane - 0.8)
        item = pick(random, [table, cabinet, shelf, chair])(random)
        parts.append(moved(item, (x, y, 0), yaw=random.integers(8) * np.pi / 4))
    for side in sides(ring(length, depth)):
        for _ in range(3):
            item = pick(random, [cabinet, shelf, chair])(random)
            parts.append(beside_wall(random, side, 0.4, item))
    for _ in range(2):
        spot = random.uniform([lane, lane], [length - lane, depth - lane])
        someone = person(random.uniform(1.6, 1.9))
        parts.append(moved(someone, (*spot, 0), yaw=random.uniform(0, 6)))
    way = ring(length - 2 * lane, depth - 2 * lane, offset=lane)
    movers = [walker(random, way + random.normal(size=(4, 2)) * 0.3) for _ in range(2)]
    return parts, movers, way, random.uniform(0.6, 1.0)


def outdoor(random: np.random.Generator) -> Layout:
    """Return a yard among buildings."""
    parts = [slab((-30, -30), (30, 30), 0.0, "asphalt")]
    for k in range(3):
        angle = k * 2.1 + random.uniform(0, 0.8)
        centre = random.uniform(13, 18) * np.array([np.cos(angle), np.sin(angle)])
        along = random.uniform(5, 9) * np.array([-np.sin(angle), np.cos(angle)])
        kinds = ["glass", "metal", "glass", "column"]
        front = random.choice(["brick", "concrete"])
        parts.append(
            wall_with_openings(
                random, centre + along, centre - along, 6.0, front, kinds
            )
        )
        behind = centre * 1.5
        parts.append(wall(behind + along, behind - along, 6.0, front))
    for _ in range(random.integers(7, 12)):
        spot = _ring_spot(random, 4.5, 16)
        parts.append(moved(tree(random, random.uniform(3, 6)), spot))
    for _ in range(random.integers(4, 7)):
        spot = _ring_spot(random, 4.5, 14)
        parts.append(moved(pole(random.uniform(0.05, 0.1), 5.0, "metal"), spot))
    for _ in range(random.integers(3, 6)):
        spot, parked = _ring_spot(random, 8.5, 14), car(random.uniform(3.9, 4.7))
        parts.append(moved(parked, spot, yaw=random.uniform(0, 6)))
    for _ in range(4):
        spot = _ring_spot(random, 5.5, 15)
        parts.append(moved(boulder(random, random.uniform(0.3, 0.9), "grass"), spot))
    angles = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles)], -1)
    road = np.column_stack([6.8 * circle, np.zeros(8)])
    drive = walk(random, road, speed_mps=4.0, rounding_m=1.0)
    movers = [
        make_body(random, car(4.3), trajectory=drive),
        walker(random, 5.0 * circle[::-1]),
        walker(random, 2.0 * circle),
    ]
    way = 3.4 * circle[:: random.choice([-1, 1])]
    return parts, movers, way, random.uniform(0.9, 1.3)


def corridor(random: np.random.Generator) -> Layout:
    """Return a long corridor with one side of glass between posts."""
    length, width = random.uniform(24, 34), random.uniform(2.2, 3.2)
    height = random.uniform(2.6, 3.2)
    parts = [
        slab((0, -9), (length, width + 4), 0.0, "floor"),
        slab((0, 0), (length, width), height, "ceiling"),
        wall_with_openings(
            random, (0.0, width), (length, width), height, "concrete", INDOORS
        ),
        wall((0, 0), (0, width), height, "concrete", openings=((0.5, 1.0, "metal"),)),
        wall((length, width), (length, 0), height, "concrete"),
        glass_front(0, length, 0, height),
        wall((length, -8.0), (0, -8.0), 4.0, "brick", openings=((4.0, 3.0, "glass"),)),
    ]
    for x in np.arange(0.0, length, random.uniform(1.8, 3.0)):
        parts.append(moved(box((0.06, 0.12, height), "metal"), (x, 0.0, 0)))
    for _ in range(5):  # outside, behind the glass
        spot = (random.uniform(2, length - 2), random.uniform(-6.5, -1.5), 0.0)
        item = tree(random, 3.5) if random.random() < 0.6 else car(4.2)
        parts.append(moved(item, spot))
    for _ in range(random.integers(3, 6)):
        x = random.uniform(1, length - 1)
        parts.append(moved(hall_item(random), (x, width - 0.3, 0), yaw=np.pi))
    way = rectangle((1.5, width / 2 - 0.3), (length - 1.5, width / 2 + 0.3))
    parts += lamps(random, way[:2] + [0, 0.3], height)
    movers = [walker(random, way[::-1] + [0, 0.15])]
    return parts, movers, way, random.uniform(0.8, 1.2)


def hall(random: np.random.Generator) -> Layout:
    """Return a high hall with columns and a glass front."""
    length, depth = random.uniform(16, 24), random.uniform(12, 16)
    height = random.uniform(4.5, 6.5)
    parts = shell(random, length, depth, height, "concrete", ["metal", "wood", "open"])
    parts.append(glass_front(1, length - 1, 0.4, 4))
    for x in np.arange(4.0, length - 3, random.uniform(3.5, 5.0)):
        for y in (depth * 0.3, depth * 0.7):
            parts.append(moved(pole(0.3, height, "concrete", sides=16), (x, y, 0)))
    parts.append(moved(box((3.0, 0.8, 1.1), "wood"), (length / 2, depth / 2, 0)))
    for _ in range(random.integers(5, 9)):
        spot = random.uniform([2, 2], [length - 2, depth - 2])
        item = pick(random, [chair, table, bench])(random)
        parts.append(moved(item, (*spot, 0), yaw=random.uniform(0, 6)))
    way = ring(length - 4.4, depth - 4.4, offset=2.2)
    cross = rectangle((3, depth / 2 + 1.2), (length - 3, depth / 2 - 1.2))
    movers = [
        walker(random, cross),
        walker(random, way[::-1] * 0.97),
        walker(random, cross[::-1] + 0.4),
    ]
    return parts, movers, way, random.uniform(0.8, 1.2)


def forest(random: np.random.Generator) -> Layout:
    """Return a clearing in a wood, with a path around it."""
    parts = [slab((-30, -30), (30, 30), 0.0, "grass")]
    for _ in range(random.integers(22, 34)):
        spot = _ring_spot(random, 4.3, 18)
        parts.append(moved(tree(random, random.uniform(5, 11)), spot))
    for _ in range(random.integers(8, 16)):  # bushes
        spot = _ring_spot(random, 4.3, 14)
        parts.append(moved(tree(random, random.uniform(1.0, 2.2)), spot))
    for _ in range(random.integers(3, 7)):
        spot = _ring_spot(random, 4.3, 14)
        parts.append(moved(boulder(random, random.uniform(0.3, 1.0), "rock"), spot))
    for _ in range(random.integers(2, 5)):  # fallen or cut
        log = box((random.uniform(2, 4), 0.35, 0.35), "wood")
        spot = _ring_spot(random, 5.0, 12)
        parts.append(moved(log, spot, yaw=random.uniform(0, 6)))
    angles = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles)], -1)
    movers = [walker(random, 2.0 * circle)] if random.random() < 0.5 else []
    way = 3.2 * circle[:: random.choice([-1, 1])]
    return parts, movers, way, random.uniform(0.7, 1.2)


FAMILIES: dict[str, Callable] = {
    family.__name__: family
    for family in (
        *(hallways, mine, lab, outdoor, corridor, hall),
        *(home, warehouse, forest, plantroom),
    )
} | {kind: functools.partial(make_layout, kind) for kind in (*KINDS, TUNNEL)}


def _ring_spot(random, near, far):
    """Return a random place on the ground between two circles."""
    angle, radius = random.uniform(0, 2 * np.pi), random.uniform(near, far)
    return radius * np.array([np.cos(angle), np.sin(angle), 0])
