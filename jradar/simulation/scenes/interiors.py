"""More kinds of places indoors: a furnished home, a warehouse and a plant room.

home       a living room, with a bedroom and a kitchen behind open doors
warehouse  high racks of metal full of goods, with aisles between them
plantroom  boilers, tanks, pumps and switch cabinets, with pipes between them
"""

import numpy as np

from jradar.simulation.scenes.building import (
    beside_wall,
    floor_and_ceiling,
    lamps,
    rectangle,
    ring,
    shell,
    sides,
    walker,
    wall_with_openings,
)
from jradar.simulation.scenes.furniture import (
    bed,
    cabinet,
    chair,
    counter,
    pick,
    rack_bay,
    shelf,
    sofa,
    table,
    wardrobe,
)
from jradar.simulation.scenes.kinds import Layout
from jradar.simulation.scenes.scene import make_body
from jradar.simulation.scenes.solids import (
    Solid,
    box,
    boxes,
    join,
    moved,
    person,
    pipe,
    pole,
    posts,
    wall,
)
from jradar.simulation.scenes.trajectory import walk

LANE_M = 1.15  # from the walls of a living room to the path through it


def home(random: np.random.Generator) -> Layout:
    """Return a flat of three rooms; the path leads around the living room."""
    length, depth = random.uniform(5.2, 7.5), random.uniform(4.8, 6.5)
    beyond, height = random.uniform(3.0, 4.2), random.uniform(2.4, 2.8)
    split = depth * random.uniform(0.4, 0.6)
    outer = str(random.choice(["brick", "concrete", "drywall"]))
    (first, *others) = sides(rectangle((0, 0), (length + beyond, depth)))
    parts = [
        *floor_and_ceiling(length + beyond, depth, height),
        *(
            wall_with_openings(random, b, a, height, outer, ["glass", "wood"])
            for a, b in (first, *others)
        ),
        wall((length, split), (length + beyond, split), height, "drywall"),
        wall(
            (length, 0),
            (length, depth),
            height,
            "drywall",
            openings=[
                (split * random.uniform(0.2, 0.4), 0.9, "open"),
                (split + (depth - split) * random.uniform(0.2, 0.4), 0.9, "open"),
            ],
        ),
    ]
    living = sides(ring(length, depth))
    for side, item in zip(
        living[:1] + living[2:], (sofa, shelf, wardrobe), strict=True
    ):
        parts.append(beside_wall(random, side, 0.45, item(random)))
        parts.append(
            beside_wall(random, side, 0.35, pick(random, [chair, cabinet])(random))
        )
    parts.append(moved(table(random), (length / 2, depth / 2, 0)))
    for turn in (0.0, np.pi):
        spot = length / 2 + 0.45 * np.cos(turn), depth / 2 - 0.55
        parts.append(moved(chair(random), (*spot, 0), yaw=turn + np.pi / 2))
    bedroom = sides(rectangle((length, 0), (length + beyond, split)))
    parts.append(beside_wall(random, bedroom[1], 1.0, bed(random)))
    parts.append(beside_wall(random, bedroom[0], 0.35, wardrobe(random)))
    kitchen = sides(rectangle((length, split), (length + beyond, depth)))
    parts.append(beside_wall(random, kitchen[2], 0.35, counter(random)))
    parts.append(beside_wall(random, kitchen[1], 0.4, table(random)))
    way = ring(length - 2 * LANE_M, depth - 2 * LANE_M, offset=LANE_M)
    parts += lamps(random, ring(length / 2, depth / 2, offset=length / 4), height)
    someone = person(random.uniform(1.55, 1.9))
    spot = (length + beyond / 2, split / 2, 0)
    parts.append(moved(someone, spot, yaw=random.uniform(0, 6)))
    movers = [walker(random, way[::-1] + random.normal(scale=0.1, size=2))]
    return parts, movers, way, random.uniform(0.4, 0.9)


def warehouse(random: np.random.Generator) -> Layout:
    """Return a hall with rows of racks; the path leads around one of them."""
    rows, bays = int(random.integers(3, 5)), int(random.integers(4, 7))
    aisle, height = random.uniform(2.5, 3.5), random.uniform(5.5, 8.0)
    bay, rack = random.uniform(2.3, 2.8), 1.0
    end = 2.2
    length, depth = bays * bay + 2 * end, rows * rack + (rows + 1) * aisle
    kinds = ["metal", "column", "wood"]
    parts = shell(random, length, depth, height, "concrete", kinds)
    levels = random.uniform(1.3, 1.8)
    for row in range(rows):
        y = aisle + row * (aisle + rack) + rack / 2
        for k in range(bays):
            x = end + (k + 0.5) * bay
            filled = rack_bay(random, bay, rack, height=height - 1.5, level=levels)
            parts.append(moved(filled, (x, y, 0)))
    for _ in range(random.integers(3, 7)):  # pallets at the ends of the racks
        x = random.choice([0.7, length - 0.7])
        y = random.uniform(1.0, depth - 1.0)
        goods = box((0.8, 1.2, random.uniform(0.15, 1.2)), "wood")
        parts.append(moved(goods, (x, y, 0)))
    around = int(random.integers(rows - 1))

    def loop(row):
        low = aisle / 2 + row * (aisle + rack)
        return rectangle((end - 0.9, low), (length - end + 0.9, low + aisle + rack))

    way = loop(around)
    parts += lamps(random, way, height)
    truck = walk(
        random,
        np.column_stack([loop(rows - 1)[::-1], np.zeros(4)]),
        speed_mps=random.uniform(1.0, 2.0),
        rounding_m=0.8,
    )
    movers = [
        make_body(random, _forklift(), trajectory=truck),
        walker(random, way[::-1] + random.normal(scale=0.2, size=2)),
    ]
    return parts, movers, way, random.uniform(0.7, 1.2)


def _forklift():
    """Return a forklift that faces x."""
    body, weight = (
        ((1.9, 1.1, 0.7), (-0.2, 0, 0.15)),
        ((0.5, 1.1, 0.5), (-0.95, 0, 0.6)),
    )
    roof, mast = ((1.3, 1.0, 0.05), (-0.15, 0, 2.1)), ((0.12, 0.8, 2.2), (0.8, 0, 0.05))
    pillars = posts((0.06, 0.06, 1.3), "metal", (-0.7, 0.4), (-0.45, 0.45), z=0.8)
    forks = posts((1.0, 0.12, 0.05), "metal", (1.3,), (-0.3, 0.3), z=0.1)
    return join(boxes("metal", body, weight, roof, mast) + pillars + forks)


def plantroom(random: np.random.Generator) -> Layout:
    """Return a room of boilers and tanks; the path leads around the middle row."""
    length, depth = random.uniform(12, 18), random.uniform(9, 12)
    height = random.uniform(3.5, 5.5)
    kinds = ["metal", "column", "open"]
    parts = shell(random, length, depth, height, "concrete", kinds)
    deep = random.uniform(1.6, 2.0)  # of what stands along the walls
    machines = [_boiler, _tank, _lying_tank, _pump, _switchgear]
    for start, end, y in (
        (0.8, length - 0.8, deep / 2),
        (0.8, length - 0.8, depth - deep / 2),
        (deep + 2.2, length - deep - 2.2, depth / 2),
    ):
        x = start + random.uniform(0.5, 1.0)
        while x < end - 0.8:
            item, width = pick(random, machines)(random)
            x += width / 2
            if x + width / 2 < end:
                parts.append(moved(item, (x, y, 0)))
                if random.random() < 0.6:  # its connection to the pipes above
                    rise = pole(random.uniform(0.03, 0.09), height - 0.5, "metal")
                    parts.append(moved(rise, (x, y + 0.1, 0)))
            x += width / 2 + random.uniform(0.3, 1.2)
        for _ in range(random.integers(2, 5)):
            at = (y + random.uniform(-0.4, 0.4), random.uniform(0.75, 0.92) * height)
            parts.append(pipe((0.3, *at), (length - 0.3, *at), _bore(random)))
    for _ in range(random.integers(2, 5)):  # across
        at, z = random.uniform(1, length - 1), random.uniform(0.65, 0.9) * height
        parts.append(pipe((at, 0.2, z), (at, depth - 0.2, z), _bore(random)))
    lane = deep + 0.9
    way = rectangle((lane, lane), (length - lane, depth - lane))
    parts += lamps(random, way, height)
    movers = [walker(random, way[::-1] + random.normal(scale=0.1, size=2))]
    return parts, movers, way, random.uniform(0.5, 1.0)


def _bore(random) -> float:
    """Return the radius of a pipe with its insulation."""
    return float(np.exp(random.uniform(np.log(0.03), np.log(0.18))))


def _boiler(random) -> tuple[Solid, float]:
    """Return a boiler on its plinth, with the burner to the front, and its width."""
    width, tall = random.uniform(0.9, 1.5), random.uniform(1.2, 2.0)
    parts = [box((width, 1.3, 0.15), "concrete"), box((width, 1.2, tall), "metal")]
    parts.append(moved(box((0.35, 0.3, 0.35), "metal"), (0, -0.7, 0.5)))
    return join(parts), width


def _tank(random) -> tuple[Solid, float]:
    """Return an upright tank on a foot, and its width."""
    radius = random.uniform(0.35, 0.75)
    body = pole(radius, random.uniform(1.4, 2.6), "metal", sides=20)
    foot = pole(0.8 * radius, 0.2, "metal", sides=20)
    return join([foot, moved(body, (0, 0, 0.2))]), 2 * radius


def _lying_tank(random) -> tuple[Solid, float]:
    """Return a tank that lies on two saddles, and its width."""
    radius, width = random.uniform(0.4, 0.7), random.uniform(1.6, 2.6)
    axis = (0.0, radius + 0.3)
    parts = posts((0.15, radius, 0.5), "metal", (-width / 3, width / 3), (0.0,))
    parts.append(pipe((-width / 2, *axis), (width / 2, *axis), radius, sides=20))
    return join(parts), width


def _pump(random) -> tuple[Solid, float]:
    """Return a pump and its motor on a frame, and its width."""
    width, axis = random.uniform(0.8, 1.4), (0.0, random.uniform(0.4, 0.6))
    parts = [box((width, 0.5, 0.2), "concrete"), box((0.3, 0.35, 0.8), "metal")]
    parts.append(pipe((0, *axis), (width / 2, *axis), 0.17))
    return join(parts), width


def _switchgear(random) -> tuple[Solid, float]:
    """Return a row of switch cabinets, and its width."""
    doors, tall = int(random.integers(1, 4)), random.uniform(1.8, 2.2)
    parts = [
        moved(box((0.78, 0.5, tall), "metal"), (0.8 * (k - (doors - 1) / 2), 0, 0.1))
        for k in range(doors)
    ]
    return join(parts), 0.8 * doors
