"""Furniture of simulated rooms: random solids that stand on z = 0."""

from collections.abc import Callable

import numpy as np

from jradar.simulation.scenes.solids import Solid, box, join, moved, pole, posts


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
    seat = moved(box((1.3, 0.4, 0.05), "wood"), (0, 0, 0.43))
    legs = posts((0.05, 0.35, 0.43), "metal", (-0.5, 0.5), (0,))
    return join([seat, *legs])


def waste_bin(random: np.random.Generator) -> Solid:
    """Return a bin of metal or plastic."""
    return pole(0.2, random.uniform(0.5, 0.9), str(random.choice(["metal", "plastic"])))


def table(random: np.random.Generator) -> Solid:
    """Return a table with a screen on it."""
    width = random.uniform(1.2, 1.8)
    top = moved(box((width, 0.75, 0.03), "wood"), (0, 0, 0.71))
    x = width / 2 - 0.05
    legs = posts((0.04, 0.04, 0.71), "metal", (-x, x), (-0.33, 0.33))
    screen = moved(
        box((0.55, 0.03, 0.35), "plastic"), (random.uniform(-0.3, 0.3), 0.2, 0.85)
    )
    return join([top, *legs, screen])


def shelf(random: np.random.Generator) -> Solid:
    """Return a shelf of metal with boxes in it."""
    height = random.uniform(1.4, 2.1)
    boards = [
        moved(box((0.9, 0.35, 0.03), "metal"), (0, 0, z))
        for z in np.linspace(0.1, height, 5)
    ]
    frame = posts((0.04, 0.04, height), "metal", (-0.43, 0.43), (-0.15, 0.15))
    boxes = [
        moved(
            box((random.uniform(0.2, 0.5), 0.25, 0.25), "wood"),
            (random.uniform(-0.25, 0.25), 0, z + 0.03),
        )
        for z in np.linspace(0.1, height, 5)[:-1]
    ]
    return join([*boards, *frame, *boxes])


def chair(random: np.random.Generator) -> Solid:
    """Return a chair on one leg."""
    parts = [
        moved(box((0.45, 0.45, 0.05), "plastic"), (0, 0, 0.43)),
        moved(box((0.05, 0.42, 0.5), "plastic"), (-0.22, 0, 0.48)),
        pole(0.03, 0.43, "metal", sides=8),
        moved(box((0.5, 0.06, 0.04), "metal"), (0, 0, 0.02)),
    ]
    return join(parts)


def sofa(random: np.random.Generator) -> Solid:
    """Return a sofa whose back is at its right side, -y."""
    width = random.uniform(1.5, 2.2)
    return join(
        [
            moved(box((width, 0.75, 0.42), "wood"), (0, 0, 0)),
            moved(box((width, 0.2, 0.4), "wood"), (0, -0.3, 0.42)),
            *posts((0.18, 0.75, 0.2), "wood", (-width / 2, width / 2), (0,), z=0.42),
        ]
    )


def bed(random: np.random.Generator) -> Solid:
    """Return a bed with a board at its head, -y."""
    width = random.uniform(0.9, 1.6)
    return join(
        [
            moved(box((width, 1.9, 0.3), "wood"), (0, 0, 0.1)),
            moved(box((width - 0.1, 1.85, 0.15), "plastic"), (0, 0, 0.4)),
            moved(box((width, 0.05, 0.9), "wood"), (0, -0.97, 0)),
        ]
    )


def wardrobe(random: np.random.Generator) -> Solid:
    """Return a wardrobe of wood."""
    return box((random.uniform(0.9, 1.6), 0.58, random.uniform(1.8, 2.1)), "wood")


def counter(random: np.random.Generator) -> Solid:
    """Return a kitchen's counter: cupboards, a worktop, an oven and a fridge."""
    width = random.uniform(1.2, 1.8)
    return join(
        [
            box((width, 0.58, 0.86), "wood"),
            moved(box((width, 0.62, 0.04), "wood"), (0, 0, 0.86)),
            moved(box((0.6, 0.02, 0.6), "metal"), (-width / 4, 0.31, 0.2)),
            moved(box((0.5, 0.4, 0.02), "metal"), (width / 4, 0, 0.9)),
            moved(box((0.6, 0.6, 1.7), "metal"), (width / 2 + 0.32, 0, 0)),
        ]
    )


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
