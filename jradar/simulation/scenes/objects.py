"""Single objects of the layouts in `kinds`: each is a function of a random generator.

They stand on z = 0 around x = y = 0. Their sizes vary more than those of real objects,
so that a network learns the echo, not the catalogue.
"""

import numpy as np

from jradar.simulation.scenes.solids import (
    Solid,
    boulder,
    box,
    car,
    join,
    moved,
    person,
    pole,
    posts,
    sheet,
    tree,
)

SOLID = ("concrete", "brick", "wood", "metal", "plastic")


def pillar(random: np.random.Generator) -> Solid:
    """Return a round or square pillar, 0.2 to 1 m wide and 1 to 4 m high."""
    width, height = random.uniform(0.2, 1.0), random.uniform(1.0, 4.0)
    material = str(random.choice(["concrete", "concrete", "brick", "metal"]))
    if random.random() < 0.5:
        return pole(width / 2, height, material, sides=16)
    return box((width, random.uniform(0.2, 1.0), height), material)


def post(random: np.random.Generator) -> Solid:
    """Return a thin post: a bollard, a signpost or the mast of a lamp."""
    material = str(random.choice(["metal", "metal", "wood"]))
    return pole(random.uniform(0.02, 0.12), random.uniform(0.6, 5.0), material)


def block(random: np.random.Generator) -> Solid:
    """Return a box of any proportions: a crate, a machine, a bed of plants."""
    size = np.exp(random.uniform(np.log([0.3, 0.3, 0.2]), np.log([2.5, 1.2, 2.2])))
    return box(size, str(random.choice(SOLID)))


def container(random: np.random.Generator) -> Solid:
    """Return a container of metal."""
    return box((random.uniform(2.5, 6.0), 2.4, random.uniform(2.0, 2.6)), "metal")


def kerb(random: np.random.Generator) -> Solid:
    """Return something low and long: a kerb, a step, a pipe on the ground."""
    size = random.uniform([1.5, 0.1, 0.08], [7.0, 0.5, 0.35])
    return box(size, str(random.choice(["concrete", "concrete", "wood", "metal"])))


def low_wall(random: np.random.Generator) -> Solid:
    """Return a wall of partial height, sometimes of glass."""
    size = random.uniform([1.0, 0.05, 0.5], [6.0, 0.3, 2.0])
    if random.random() < 0.25:
        return moved(_pane(size[0], 0.1, size[2]), (0, 0, 0))
    return box(size, str(random.choice(["concrete", "brick", "drywall", "wood"])))


def portal(random: np.random.Generator) -> Solid:
    """Return a beam or a plate on two posts: a bar, a sign, a canopy, a high table."""
    width, under = random.uniform(1.0, 5.0), random.uniform(0.7, 2.6)
    thick, deep = random.uniform(0.05, 0.4), random.uniform(0.05, 1.5)
    beam = moved(box((width, deep, thick), str(random.choice(SOLID))), (0, 0, under))
    side = random.uniform(0.04, 0.15)
    x = width / 2 - side / 2
    return join([beam, *posts((side, side, under), "metal", (-x, x), (0,))])


def railing(random: np.random.Generator) -> Solid:
    """Return a railing or a fence of bars, which the LiDAR partly sees through."""
    width, height = random.uniform(1.5, 5.0), random.uniform(0.8, 2.0)
    bars = np.arange(-width / 2, width / 2, random.uniform(0.12, 0.5))
    rails = [moved(box((width, 0.05, 0.05), "metal"), (0, 0, height - 0.05))]
    return join(rails + posts((0.03, 0.03, height), "metal", bars, (0,)))


def corner_reflector(random: np.random.Generator) -> Solid:
    """Return three squares of metal at right angles on a post, open towards -x."""
    side = random.uniform(0.06, 0.2)
    square = [(0, 0), (side, 0), (side, side), (0, side)]
    sheets = [
        sheet([(u, v, 0.0) for u, v in square], "metal"),
        sheet([(u, 0.0, v) for u, v in square], "metal"),
        sheet([(0.0, u, v) for u, v in square], "metal"),
    ]
    height = random.uniform(0.3, 1.8)
    turned = moved(join(sheets), (0, 0, height), yaw=np.pi * 0.75)
    return join([turned, moved(pole(0.02, height, "plastic", sides=8), (0.05, 0, 0))])


def flight(random: np.random.Generator) -> Solid:
    """Return a flight of stairs that rises along x, open or closed underneath."""
    width, steps = random.uniform(0.9, 2.5), int(random.integers(4, 18))
    rise, run = random.uniform(0.15, 0.19), random.uniform(0.25, 0.32)
    full = random.random() < 0.5
    tall = [rise * (k + 1) if full else 0.2 for k in range(steps)]
    material = str(random.choice(["concrete", "concrete", "wood", "metal"]))
    return join(
        [
            moved(
                box((run, width, height), material),
                (run * (k - steps / 2), 0, rise * (k + 1) - height),
            )
            for k, height in enumerate(tall)
        ]
    )


def someone(random: np.random.Generator) -> Solid:
    """Return a person who stands."""
    return person(random.uniform(1.2, 1.95))


def parked(random: np.random.Generator) -> Solid:
    """Return a parked car, or a van."""
    one = car(random.uniform(3.5, 5.0))
    tall = 1.0 if random.random() < 0.8 else random.uniform(1.2, 1.7)
    return one._replace(vertices=one.vertices * [1.0, 1.0, tall])


def plant(random: np.random.Generator) -> Solid:
    """Return a tree or a bush."""
    return tree(random, float(np.exp(random.uniform(np.log(0.8), np.log(9)))))


def stone(random: np.random.Generator) -> Solid:
    """Return a boulder, or a heap."""
    material = str(random.choice(["rock", "grass", "concrete"]))
    return boulder(random, random.uniform(0.2, 1.2), material)


def _pane(width, low, high):
    """Return an upright pane of glass along x."""
    x = width / 2
    return sheet([(-x, 0, low), (x, 0, low), (x, 0, high), (-x, 0, high)], "glass")
