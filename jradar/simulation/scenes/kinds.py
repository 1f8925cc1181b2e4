"""Layouts of every size and openness, each drawn from a few pieces and a seed.

A kind is a row of `KINDS`: how large its plan is, which share of its walls and its roof
stands, and what is in it. A layout is drawn without a template of walls:

    plan      a polygon: a rectangle, often with corners cut off, at any angle
    path      a loop through random places in the plan, clear of its walls
    shell     a wall on some sides with openings of any size, a roof over all or a part
    rows      columns or cars on a grid
    objects   at random places or along walls, clear of the path and of one another

room, atrium, lobby, stairwell, shed, carpark, yard, street and open are of this form.
`tunnel` is a tunnel of any radius, straight or curved, open or closed at its end.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from jradar.simulation.scenes import furniture, objects
from jradar.simulation.scenes.building import sides, walker
from jradar.simulation.scenes.scene import Body
from jradar.simulation.scenes.solids import Solid, box, moved, slab, wall
from jradar.simulation.scenes.tunnel import tube

Maker = Callable[[np.random.Generator], Solid]
Layout = tuple[list[Solid], list[Body], Float[np.ndarray, "corner 2"], float]
CLEAR_M = 0.45  # between the path and anything that stands
TRIES = 60  # to find a free place
PLAN_M = 30.0  # of the ground beyond the plan

FURNITURE: tuple[Maker, ...] = (
    *(furniture.cabinet, furniture.bench, furniture.table, furniture.shelf),
    *(furniture.chair, furniture.sofa, furniture.wardrobe, furniture.counter),
    *(furniture.bed, furniture.waste_bin),
)
SINGLE: tuple[Maker, ...] = (
    *(objects.pillar, objects.post, objects.block, objects.kerb, objects.portal),
    *(objects.low_wall, objects.railing, objects.someone, furniture.table),
    *(objects.corner_reflector, objects.plant, objects.stone, objects.parked),
)


class Kind(NamedTuple):
    """How layouts of a kind are drawn; pairs are the lowest and the highest value."""

    side_m: tuple[float, float]  # of the plan, log-uniform
    aspect: tuple[float, float]  # depth over length
    height_m: tuple[float, float]
    walls: tuple[str, ...]  # materials
    standing: float  # share of the walls
    roof: float  # share of the layouts that have one
    openings: tuple[str, ...]
    ground: tuple[str, ...]
    things: tuple[Maker, ...]
    per_100_m2: tuple[float, float]
    most: int = 40  # things
    row: Maker | None = None  # stands on a grid
    pitch_m: tuple[float, float] = (3.0, 8.0)
    people: int = 2  # who walk, at most


INSIDE = ("drywall", "concrete", "brick", "wood")
OPEN_AIR = ("brick", "concrete", "metal", "wood")
PAVED = ("asphalt", "concrete", "grass")
DOORS = ("wood", "metal", "open", "glass", "column")
KINDS: dict[str, Kind] = {
    "room": Kind(
        (3, 25), (0.4, 1.0), (2.3, 5.0), INSIDE, 0.95, 0.95, DOORS, ("floor",),
        (*FURNITURE, objects.low_wall, objects.block, objects.someone), (0, 35),
    ),
    "atrium": Kind(
        (12, 32), (0.4, 1.0), (4.0, 10.0), INSIDE, 0.9, 0.9, DOORS,
        ("floor", "concrete"),
        (objects.low_wall, objects.flight, objects.railing, objects.portal,
         objects.block, furniture.bench, objects.someone), (0, 8),
        row=objects.pillar,
    ),
    "lobby": Kind(
        (7, 18), (0.5, 1.0), (2.8, 6.0), ("drywall", "glass", "concrete"), 0.85, 1.0,
        ("glass", "open", "glass", "wood"), ("floor",),
        (furniture.sofa, furniture.counter, objects.low_wall, objects.plant,
         furniture.bench, objects.someone, objects.pillar), (2, 18),
    ),
    "stairwell": Kind(
        (3.0, 8), (0.5, 1.0), (3.0, 9.0), ("concrete", "drywall", "brick"), 1.0, 1.0,
        ("metal", "wood", "open"), ("concrete", "floor"),
        (objects.flight, objects.flight, objects.railing, objects.low_wall), (8, 30),
        people=1,
    ),
    "shed": Kind(
        (4, 16), (0.4, 1.0), (2.4, 6.0), ("metal", "wood"), 0.75, 0.9,
        ("open", "open", "metal", "wood"), ("concrete", "asphalt"),
        (objects.block, furniture.shelf, objects.post, objects.portal, objects.kerb,
         objects.container), (0, 25), people=1,
    ),
    "carpark": Kind(
        (16, 36), (0.4, 1.0), (2.4, 3.4), ("concrete",), 0.6, 0.9, ("open", "metal"),
        ("concrete", "asphalt"),
        (objects.parked, objects.parked, objects.parked, objects.pillar, objects.kerb,
         objects.low_wall, objects.post), (1, 5), row=objects.pillar,
        pitch_m=(4.0, 9.0), most=16,
    ),
    "yard": Kind(
        (10, 32), (0.4, 1.0), (1.2, 7.0), OPEN_AIR, 0.55, 0.0, DOORS, PAVED,
        (*SINGLE, objects.container, objects.flight), (0.5, 6),
    ),
    "street": Kind(
        (20, 40), (0.2, 0.5), (3.0, 9.0), OPEN_AIR, 0.5, 0.0, DOORS, ("asphalt",),
        (objects.post, objects.plant, objects.kerb, objects.someone, objects.block,
         objects.parked), (0.5, 5), row=objects.parked, pitch_m=(5.5, 9.0),
    ),
    "open": Kind(
        (14, 24), (0.7, 1.0), (2.0, 4.0), OPEN_AIR, 0.0, 0.0, (), PAVED, SINGLE,
        (0.3, 2.0), most=5, people=1,
    ),
}  # fmt: skip


def make_layout(kind: str, random: np.random.Generator) -> Layout:
    """Return the solids, the bodies that move, the path, and the pace of a layout."""
    if kind == TUNNEL:
        return _tunnel(random)
    spec, uniform = KINDS[kind], random.uniform
    length = float(np.exp(uniform(*np.log(spec.side_m))))
    depth = max(length * uniform(*spec.aspect), 2.4)
    height = uniform(*spec.height_m)
    plan = draw_plan(random, length, depth)
    way = draw_way(random, plan)
    parts = [_ground(random, plan, spec)]
    parts += _walls(random, plan, height, spec)
    if uniform() < spec.roof:
        parts += _roof(random, plan, height)
    taken = [*_rows(random, plan, way, spec)] if spec.row and uniform() < 0.8 else []
    count = round(length * depth / 100 * uniform(*spec.per_100_m2))
    for _ in range(min(max(count, 1 if kind == "open" else 0), spec.most)):
        thing = spec.things[random.integers(len(spec.things))](random)
        taken += _placed(random, thing, plan, way, taken)
    parts += [solid for solid, _, _ in taken]
    movers = [walker(random, way[::-1]) for _ in range(random.integers(spec.people))]
    return parts, movers, way, uniform(0.4, 1.5)


def draw_plan(
    random: np.random.Generator, length: float, depth: float
) -> Float[np.ndarray, "corner 2"]:
    """Return the corners of a plan about the origin, in turn to the left.

    Each corner of a rectangle is kept, cut off straight, or cut out at right angles.
    """
    half = np.array([length, depth]) / 2
    corners = []
    for signs in np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]):
        at, cut = signs * half, half * random.uniform(0.15, 0.8, 2)
        before, after = at - signs * cut * [0, 1], at - signs * cut * [1, 0]
        if signs[0] * signs[1] > 0:
            before, after = after, before
        draw = random.random()
        if draw < 0.7:
            corners.append(at)
        elif draw < 0.85:
            corners += [before, after]
        else:
            corners += [before, at - signs * cut, after]
    turn = random.uniform(0, 2 * np.pi)
    cos, sin = np.cos(turn), np.sin(turn)
    return np.array(corners) @ np.array([[cos, sin], [-sin, cos]])


def draw_way(
    random: np.random.Generator, plan: Float[np.ndarray, "corner 2"]
) -> Float[np.ndarray, "corner 2"]:
    """Return a closed line through random places that stays clear of the plan's sides.

    A narrow plan has a loop that leads there and back, a tiny one stands in its middle.
    """
    for clear in (0.8, 0.6, CLEAR_M, 0.3):
        for _ in range(TRIES):
            spots = random.uniform(plan.min(0), plan.max(0), (24, 2))
            spots = spots[_inside(plan, spots) & (_apart(plan, spots) > clear)][:4]
            if len(spots) < 3:
                continue
            offset = spots - spots.mean(0)
            spots = spots[np.argsort(np.arctan2(offset[:, 1], offset[:, 0]))]
            share = np.linspace(0, 1, 12, endpoint=False)[:, None]
            line = [a + share * (b - a) for a, b in sides(spots)]
            fine = np.concatenate(line)
            free = _inside(plan, fine) & (_apart(plan, fine) > clear)
            if free.all():
                return spots[:: random.choice([-1, 1])]
    middle = plan.mean(0)
    return middle + 0.2 * np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])


def _inside(plan, xy) -> Bool[np.ndarray, " place"]:
    """Return which places are in the plan: a ray crosses its sides an odd number."""
    a, b = plan, np.roll(plan, -1, 0)
    x, y = xy[:, None, 0], xy[:, None, 1]
    straddles = (a[:, 1] > y) != (b[:, 1] > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = a[:, 0] + (y - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b - a)[:, 0]
    return (straddles & (x < crossing)).sum(1) % 2 > 0


def _apart(line, xy) -> Float[np.ndarray, " place"]:
    """Return the distance of places to a closed line."""
    along = np.roll(line, -1, 0) - line
    offset = xy[:, None] - line
    share = (offset * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-9)
    foot = np.clip(share, 0, 1)[..., None] * along
    return np.linalg.norm(offset - foot, axis=-1).min(1)


def _ground(random, plan, spec):
    """Return a floor that reaches beyond the plan where that has no walls."""
    margin = 1.0 if spec.standing > 0.7 else PLAN_M - np.abs(plan).max()
    material = str(random.choice(spec.ground))
    return slab(plan.min(0) - margin, plan.max(0) + margin, 0.0, material)


def _walls(random, plan, height, spec):
    """Return walls on some sides of the plan, some of partial height."""
    parts = []
    for a, b in sides(plan):
        if random.random() > spec.standing:
            continue
        tall = height if random.random() < 0.9 else height * random.uniform(0.2, 0.9)
        material = str(random.choice(spec.walls))
        openings, at = [], random.uniform(0.3, 4.0)
        length = float(np.linalg.norm(b - a))
        while spec.openings and tall > 1.2:
            kind = str(random.choice(spec.openings))
            wide = random.uniform(0.2, 0.5) if kind == "column" else 0.0
            wide = wide or random.uniform(0.7, 1.2 if kind == "wood" else 3.0)
            if at + wide > length - 0.3:
                break
            openings.append((at, wide, kind))
            at += wide + random.exponential(4.0) + 0.4
        parts.append(wall(b, a, tall, material, openings=openings))
    return parts


def _roof(random, plan, height):
    """Return a ceiling, or a roof over a part, often with beams or ducts below."""
    low, high = plan.min(0) - 0.2, plan.max(0) + 0.2
    if random.random() < 0.2:  # an overhang, or a gallery below the ceiling
        axis, share = random.integers(2), random.uniform(0.2, 0.8)
        high = high.copy()
        high[axis] = low[axis] + share * (high[axis] - low[axis])
    material = str(random.choice(["ceiling", "ceiling", "concrete", "metal", "wood"]))
    parts = [slab(low, high, height, material)]
    if random.random() < 0.5:
        wide, deep = random.uniform([0.08, 0.08], [0.5, 0.6])
        under = min(deep, max(height - 2.2, 0.05))
        beam = str(random.choice(["metal", "concrete", "wood"]))
        every, (x, _) = random.uniform(1.5, 5.0), (low + high) / 2
        for y in np.arange(low[1] + 0.5, high[1], every):
            size = (high[0] - low[0], wide, under)
            parts.append(moved(box(size, beam), (x, y, height - under)))
    return parts


def _rows(random, plan, way, spec):
    """Return one solid, placed on a grid in the plan, with its place and its radius."""
    one = spec.row(random)
    turn, pitch = random.uniform(0, np.pi), random.uniform(*spec.pitch_m, 2)
    edge = plan[1] - plan[0]
    along = float(np.arctan2(edge[1], edge[0]))
    reach = np.arange(-8, 9)
    grid = np.stack(np.meshgrid(*(reach * step for step in pitch)), -1).reshape(-1, 2)
    cos, sin = np.cos(along), np.sin(along)
    spots = (grid + random.uniform(0, pitch)) @ np.array([[cos, sin], [-sin, cos]])
    radius = float(np.hypot(*one.vertices[:, :2].T).max())
    yaw = along + (np.pi / 2 if turn > np.pi / 2 else 0.0)
    free = _inside(plan, spots) & (_apart(way, spots) > radius + CLEAR_M)
    for spot in spots[free & (random.random(len(spots)) < 0.8)]:
        yield moved(one, (*spot, 0), yaw=yaw), spot, radius


def _placed(random, thing, plan, way, taken):
    """Return the thing at a free place with its place and radius, [] without one."""
    radius = float(np.hypot(*thing.vertices[:, :2].T).max())
    for _ in range(TRIES):
        spot, yaw = random.uniform(plan.min(0), plan.max(0)), random.uniform(0, 6.3)
        if random.random() < 0.4:  # along a wall
            k = random.integers(len(plan))
            a, b = plan[k], plan[(k + 1) % len(plan)]
            along = (b - a) / np.linalg.norm(b - a)
            aside = np.ptp(thing.vertices[:, 1]) / 2 + random.uniform(0.02, 0.3)
            inward = np.array([-along[1], along[0]])
            spot = a + random.random() * (b - a) + aside * inward
            yaw = float(np.arctan2(along[1], along[0]))
        clear = _apart(way, spot[None])[0] > radius + CLEAR_M
        near = any(
            np.hypot(*(spot - other)) < 0.8 * (radius + its) for _, other, its in taken
        )
        if clear and not near and _inside(plan, spot[None])[0]:
            return [(moved(thing, (*spot, 0), yaw=yaw), spot, radius)]
    return []


TUNNEL = "tunnel"
TUNNEL_THINGS = (objects.stone, objects.post, objects.block, objects.kerb)


def _tunnel(random) -> Layout:
    """Return a tunnel with a few things along its walls."""
    solid, middle, radius = tube(random)
    taken, inner = [], max(radius - CLEAR_M - 0.2, 0.1)
    way = np.concatenate([middle[2:-2:2], middle[2:-2:2][::-1] + 0.05])
    for _ in range(random.integers(0, 8)):
        thing = TUNNEL_THINGS[random.integers(len(TUNNEL_THINGS))](random)
        wide = float(np.hypot(*thing.vertices[:, :2].T).max())
        k = int(random.integers(1, len(middle) - 1))
        along = middle[k + 1] - middle[k - 1]
        yaw = float(np.arctan2(along[1], along[0]))
        side = random.choice([-1, 1]) * min(inner, wide + CLEAR_M + 0.3)
        spot = middle[k] + side * np.array([-np.sin(yaw), np.cos(yaw)])
        if abs(side) > wide / 2 + CLEAR_M and np.ptp(thing.vertices[:, 2]) < radius:
            taken.append(moved(thing, (*spot, 0), yaw=yaw))
    movers = [walker(random, way[::-1]) for _ in range(random.integers(2))]
    return [solid, *taken], movers, way, random.uniform(0.4, 1.5)
