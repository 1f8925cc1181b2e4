"""Furniture of simulated rooms: random solids that stand on z = 0."""

from collections.abc import Callable

import numpy as np

from jradar.simulation.scenes.solids import Solid, box, boxes, join, moved, pole, posts


def pick(random: np.random.Generator, makers: list[Callable]) -> Callable:
    """Return one of several functions at random."""
    return makers[random.integers(len(makers))]


def hall_item(random: np.random.Generator) -> Solid:
    """Return a random piece of furniture of a corridor."""
    return pick(random, [cabinet, bench, waste_bin, shelf])(random)


def cabinet(random: np.random.Generator) -> Solid:
    """Return a cabinet of metal or wood."""
    size = (random.uniform(0.5, 1.0), 0.45, random.uniform(0.8, 1.9))
    return box(size, str(random.choice(["metal", "metal", "wood"])))


def bench(random: np.random.Generator) -> Solid:
    """Return a bench of wood on two legs of metal."""
    seat = boxes("wood", ((1.3, 0.4, 0.05), (0, 0, 0.43)))
    return join(seat + posts((0.05, 0.35, 0.43), "metal", (-0.5, 0.5), (0,)))


def waste_bin(random: np.random.Generator) -> Solid:
    """Return a bin of metal or plastic."""
    return pole(0.2, random.uniform(0.5, 0.9), str(random.choice(["metal", "plastic"])))


def table(random: np.random.Generator) -> Solid:
    """Return a table with a screen on it."""
    width = random.uniform(1.2, 1.8)
    top = boxes("wood", ((width, 0.75, 0.03), (0, 0, 0.71)))
    x = width / 2 - 0.05
    legs = posts((0.04, 0.04, 0.71), "metal", (-x, x), (-0.33, 0.33))
    place = (random.uniform(-0.3, 0.3), 0.2, 0.85)
    return join(top + legs + boxes("plastic", ((0.55, 0.03, 0.35), place)))


def shelf(random: np.random.Generator) -> Solid:
    """Return a shelf of metal with boxes in it."""
    height = random.uniform(1.4, 2.1)
    levels = np.linspace(0.1, height, 5)
    boards = boxes("metal", *(((0.9, 0.35, 0.03), (0, 0, z)) for z in levels))
    frame = posts((0.04, 0.04, height), "metal", (-0.43, 0.43), (-0.15, 0.15))
    for z in levels[:-1]:
        size = (random.uniform(0.2, 0.5), 0.25, 0.25)
        frame += boxes("wood", (size, (random.uniform(-0.25, 0.25), 0, z + 0.03)))
    return join(boards + frame)


def chair(random: np.random.Generator) -> Solid:
    """Return a chair on one leg."""
    back = ((0.05, 0.42, 0.5), (-0.22, 0, 0.48))
    seat = boxes("plastic", ((0.45, 0.45, 0.05), (0, 0, 0.43)), back)
    foot = boxes("metal", ((0.5, 0.06, 0.04), (0, 0, 0.02)))
    return join([*seat, pole(0.03, 0.43, "metal", sides=8), *foot])


def sofa(random: np.random.Generator) -> Solid:
    """Return a sofa whose back is at its right side, -y."""
    width = random.uniform(1.5, 2.2)
    back = ((width, 0.2, 0.4), (0, -0.3, 0.42))
    seat = boxes("wood", ((width, 0.75, 0.42), (0, 0, 0)), back)
    x = width / 2
    return join(seat + posts((0.18, 0.75, 0.2), "wood", (-x, x), (0,), z=0.42))


def bed(random: np.random.Generator) -> Solid:
    """Return a bed with a board at its head, -y."""
    width = random.uniform(0.9, 1.6)
    frame = boxes("wood", ((width, 1.9, 0.3), (0, 0, 0.1)))
    mattress = boxes("plastic", ((width - 0.1, 1.85, 0.15), (0, 0, 0.4)))
    board = boxes("wood", ((width, 0.05, 0.9), (0, -0.97, 0)))
    return join(frame + mattress + board)


def wardrobe(random: np.random.Generator) -> Solid:
    """Return a wardrobe of wood."""
    return box((random.uniform(0.9, 1.6), 0.58, random.uniform(1.8, 2.1)), "wood")


def counter(random: np.random.Generator) -> Solid:
    """Return a kitchen's counter: cupboards, a worktop, an oven and a fridge."""
    width = random.uniform(1.2, 1.8)
    top = ((width, 0.62, 0.04), (0, 0, 0.86))
    cupboards = boxes("wood", ((width, 0.58, 0.86), (0, 0, 0)), top)
    oven = ((0.6, 0.02, 0.6), (-width / 4, 0.31, 0.2))
    hob = ((0.5, 0.4, 0.02), (width / 4, 0, 0.9))
    fridge = ((0.6, 0.6, 1.7), (width / 2 + 0.32, 0, 0))
    return join(cupboards + boxes("metal", oven, hob, fridge))


def rack_bay(
    random: np.random.Generator,
    width: float,
    depth: float,
    *,
    height: float,
    level: float,
) -> Solid:
    """Return a bay of a pallet rack along x: posts, beams and goods on each level."""
    xs, ys = (-width / 2, width / 2), (-depth / 2, depth / 2)
    frame = posts((0.09, 0.09, height), "metal", xs, ys)
    beams, goods = [], []
    for z in np.arange(0.12, height - 0.3, level):
        beams += posts((width, 0.05, 0.12), "metal", (0,), ys, z=z - 0.12)
        for x in (-width / 4, width / 4):
            if random.random() < 0.8:
                material = str(random.choice(["wood", "wood", "plastic", "metal"]))
                size = random.uniform([0.7, 0.6, 0.3], [1.1, 0.95, level - 0.25])
                goods.append(moved(box(size, material), (x, 0, z)))
    return join([*frame, *beams, *goods])
