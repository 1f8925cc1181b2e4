"""Small scenes with known answers, seen from a platform at a known place."""

import numpy as np
import pytest

from jradar.simulation.paths.reflectors import find_reflectors
from jradar.simulation.scenes.scene import Scene, make_body
from jradar.simulation.scenes.solids import join, moved, sheet
from jradar.simulation.scenes.trajectory import STILL, Trajectory, loop

pytest.importorskip("embreex", reason="the extra `sim` is not installed")


def straight(speed_mps=0.0, height=1.2):
    """A platform that passes x = y = 0 along x at time 0."""
    corners = np.array([(-20, 0), (20, 0), (20, -40), (-20, -40)], float)
    curve = loop(np.column_stack([corners, np.full(4, height)]), rounding_m=0.5)
    at = np.linspace(5, 35, 30_001)
    start = at[np.abs(curve(at)[:, 0]).argmin()]
    axis = np.array([0, 1.0, 0])
    return Trajectory(curve, float(curve.x[-1]), speed_mps, start, axis, STILL)


def world(solids, *, movers=(), speed_mps=0.0):
    """A scene and its reflectors; `movers` are pairs of solid and trajectory."""
    random = np.random.default_rng(0)
    bodies = [make_body(random, join(list(solids)))]
    bodies += [make_body(random, solid, trajectory=way) for solid, way in movers]
    scene = Scene("test", tuple(bodies), straight(speed_mps))
    return scene, find_reflectors(scene.bodies)


def wall(x, material, y=(-8, 8), z=(-8, 10)):
    """A sheet across the x axis."""
    (left, right), (low, high) = y, z
    corners = [(x, left, low), (x, right, low), (x, right, high), (x, left, high)]
    return sheet(corners, material)


def corner_reflector(xyz, side=0.2):
    """Three squares of metal that open towards where x is smaller, on edge."""
    square = [(0, 0), (side, 0), (side, side), (0, side)]
    sheets = [
        sheet([(u, v, 0.0) for u, v in square], "metal"),
        sheet([(u, 0.0, v) for u, v in square], "metal"),
        sheet([(0.0, u, v) for u, v in square], "metal"),
    ]
    solid = moved(join(sheets), (0, 0, 0), yaw=np.pi * 0.75)
    return moved(solid, xyz)
