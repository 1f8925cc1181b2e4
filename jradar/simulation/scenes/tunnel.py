"""Tunnels: a winding one along a closed curve, and any others with two ends."""

import numpy as np
from jaxtyping import Float

from jradar.simulation.scenes.materials import MATERIAL_IDS
from jradar.simulation.scenes.solids import Solid

AROUND = 36  # vertices of a cross-section
EVERY_M = 0.3  # along the tunnel


def tunnel(random: np.random.Generator) -> tuple[Solid, Float[np.ndarray, "place 2"]]:
    """Return the rock about a closed drift, 50 to 80 m long, and its middle line.

    The section is a horseshoe about 3 m wide with a rubble floor. Waves of 0.3 to 8 m
    in its radius form niches and ribs.
    """
    angle = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    radius = np.full_like(angle, random.uniform(8, 12))
    for order in (2, 3, 4, 5):
        swell = random.uniform(0.3, 2.2) / order
        radius += swell * np.sin(order * angle + random.uniform(0, 2 * np.pi))
    line = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    metres = np.r_[0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=-1))]
    count = int(metres[-1] / EVERY_M)
    at = np.linspace(0, metres[-1], count, endpoint=False)
    line = np.stack([np.interp(at, metres, column) for column in line.T], -1)

    along = np.roll(line, -1, 0) - np.roll(line, 1, 0)
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    left = np.stack([-along[:, 1], along[:, 0]], -1)
    turn = np.linspace(0, 2 * np.pi, AROUND, endpoint=False)
    section = 1.45 + 0.12 * np.cos(2 * turn) + 0.06 * np.cos(4 * turn)
    reach = section[None] * (1 + _roughness(random, at, metres[-1], turn))
    aside, up = reach * np.cos(turn), 1.35 + reach * np.sin(turn)
    floor = 0.06 * _roughness(random, at, metres[-1], turn) / 0.1
    up = np.maximum(up, np.clip(floor, -0.08, 0.12))
    xy = line[:, None] + aside[..., None] * left[:, None]
    vertices = np.concatenate([xy, up[..., None]], -1).reshape(-1, 3)

    place, corner = np.meshgrid(np.arange(count), np.arange(AROUND), indexing="ij")
    after, beside = (place + 1) % count, (corner + 1) % AROUND
    a, b = place * AROUND + corner, after * AROUND + corner
    c, d = after * AROUND + beside, place * AROUND + beside
    faces = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], 2)
    faces = faces.reshape(-1, 3)
    return Solid(vertices, faces, np.full(len(faces), MATERIAL_IDS["rock"])), line


def _roughness(random, at, length, turn):
    """Return relative bumps, closed along and around, of standard deviation 0.1."""
    bumps = np.zeros((len(at), len(turn)))
    for _ in range(40):
        wave_m = np.exp(random.uniform(np.log(0.7), np.log(8)))
        cycles, around = round(length / wave_m), random.integers(0, 7)
        phase = 2 * np.pi * (cycles * at[:, None] / length + random.random())
        bumps += wave_m**0.5 * np.sin(phase + around * turn)
    bumps *= 0.1 / bumps.std()
    return bumps + 0.02 * random.normal(size=bumps.shape)


def tube(
    random: np.random.Generator,
) -> tuple[Solid, Float[np.ndarray, "place 2"], float]:
    """Return a tunnel of any size, the line along its middle, and its half width.

    The section is round, a horseshoe or a box, 1.6 to 12 m wide, over a flat floor. The
    tunnel is straight or bends with a radius of 8 m or more, is 14 to 45 m long, and
    each end is open or closed. Walls are smooth concrete or rough rock.
    """
    half = float(np.exp(random.uniform(np.log(0.8), np.log(6))))
    length, height = random.uniform(14, 45), max(half * random.uniform(0.8, 1.8), 2.0)
    bend = 0.0 if random.random() < 0.35 else 1 / random.uniform(max(8, 3 * half), 60)
    bend *= random.choice([-1, 1])
    rough, material, around, every_m = 0.0, "concrete", 16, 2.0
    if random.random() < 0.5:
        rough, material = random.uniform(0.3, 1.2), "rock"
        around, every_m = AROUND, max(EVERY_M, half / 8)
    count = int(length / every_m)
    at = np.linspace(0, length, count)
    heading = bend * at + random.uniform(0, 2 * np.pi)
    along = np.stack([np.cos(heading), np.sin(heading)], -1)
    line = np.cumsum(along * length / (count - 1), 0)
    left = np.stack([-along[:, 1], along[:, 0]], -1)

    turn = np.linspace(0, 2 * np.pi, around, endpoint=False)
    power = random.choice([1.0, 0.5, 0.15])  # of a superellipse: round to box
    section = np.abs(np.cos(turn)) ** power * np.sign(np.cos(turn))
    rise = np.abs(np.sin(turn)) ** power * np.sign(np.sin(turn))
    bumps = 1 + rough * _roughness(random, at, length, turn)
    aside = half * bumps * section
    up = np.maximum(height * bumps * rise + 0.35 * height, 0.0)
    xy = line[:, None] + aside[..., None] * left[:, None]
    vertices = np.concatenate([xy, up[..., None]], -1).reshape(-1, 3)
    place, corner = np.meshgrid(np.arange(count - 1), np.arange(around), indexing="ij")
    beside = (corner + 1) % around
    a, b = place * around + corner, (place + 1) * around + corner
    c, d = (place + 1) * around + beside, place * around + beside
    faces = [np.stack([a, b, c], -1), np.stack([a, c, d], -1)]
    ring = np.array([(0, k, k + 1) for k in range(1, around - 1)])
    ends = [ring + last for last in (0, (count - 1) * around) if random.random() < 0.5]
    joined = np.concatenate([face.reshape(-1, 3) for face in faces] + ends)
    made = Solid(vertices, joined, np.full(len(joined), MATERIAL_IDS[material]))
    return made, line, half
