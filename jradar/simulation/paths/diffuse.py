"""Diffuse echoes of a room: the sum of all paths that no scene models one by one.

A signal that is scattered several times returns from everywhere and late. The sum of
many such paths is complex Gaussian in every range bin, falls with range, and stands
still in the room. Many weak scatterers in random directions around the radar give these
statistics: their amplitude falls as 1/R, and the antennas weigh their directions. A
radar that moves sees each under its own Doppler shift; once it has moved by `FRESH_M`,
the paths are others.
"""

import numpy as np

from jradar.radar import RadarSpec
from jradar.simulation.paths.line_of_sight import Paths
from jradar.simulation.paths.link import FULL_SCALE, LINK
from jradar.simulation.rig import Viewpoint

POINTS = 1024  # scatterers of a frame
NEAREST_M = 0.5
AZIMUTH, ELEVATION = np.pi / 2, np.pi / 3  # largest angles
FRESH_M = 0.05
CELL_M, AT_M = 0.117, 3.0  # where `counts` was measured


def diffuse_clutter(
    seed: int, view: Viewpoint, radar: RadarSpec, *, counts: float
) -> Paths:
    """Return diffuse echoes of `counts` rms in a range bin of 0.117 m at 3 m.

    The rms amplitude, in ADC counts of one antenna, falls as 1/R, and grows with the
    root of the bin's width.
    """
    place = np.floor(np.asarray(view.xyz) / FRESH_M).astype(int) + (1 << 20)
    random = np.random.default_rng([seed, *b"clutter", *place])
    distance = random.uniform(NEAREST_M, LINK.reach_m(radar), POINTS)
    azimuth = random.uniform(-AZIMUTH, AZIMUTH, POINTS)
    height = random.uniform(-np.sin(ELEVATION), np.sin(ELEVATION), POINTS)
    ground = np.sqrt(1 - height**2)
    direction = np.stack(
        [ground * np.cos(azimuth), ground * np.sin(azimuth), height], -1
    )
    weight = LINK.antenna_gain(direction) ** 2  # both ways
    per_cell = POINTS * CELL_M / (LINK.reach_m(radar) - NEAREST_M)
    squared = counts**2 * (AT_M / distance) ** 2 / per_cell
    squared *= weight / weight.mean() * random.exponential(size=POINTS)
    power = squared / FULL_SCALE**2 * 10 ** (LINK.full_scale_dbm / 10)
    velocity = -(direction @ (view.velocity @ view.turn))
    xyz = direction * distance[:, None]
    return Paths(xyz, xyz, velocity, power)
