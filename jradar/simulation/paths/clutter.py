"""Clutter: the diffuse echoes of a room, and leaves that the wind moves.

A signal that is scattered several times returns from everywhere and late. The sum of
many such paths is complex Gaussian in every range bin, falls with range, and stands
still in the room. Many weak scatterers in random directions around the radar give these
statistics: their amplitude falls as 1/R, and the antennas weigh their directions. A
radar that moves sees each under its own Doppler shift; once it has moved by `FRESH_M`,
the paths are new.

Billingsley (2002, Low-angle radar land clutter, ch. 6) measured forests from VHF to X
band. A share r / (1 + r) of the power stands still. The rest has an exponential
spectrum over the velocity v,

    P(v) = beta / 2 exp(-beta |v|),    r = 489.8 w^-1.55 f^-1.21

with the wind w in miles per hour and the carrier f in GHz. beta depends on the wind
alone. At 77 GHz, which extrapolates the measurements, a breeze leaves almost nothing
standing.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from jradar.radar import RadarSpec
from jradar.simulation.paths.line_of_sight import Paths
from jradar.simulation.paths.link import FULL_SCALE, LINK
from jradar.simulation.rig import Viewpoint

POINTS = 1024  # scatterers of a frame
NEAREST_M = 0.5
AZIMUTH, ELEVATION = np.pi / 2, np.pi / 3  # largest angles
FRESH_M = 0.05
CELL_M, AT_M = 0.117, 3.0  # where `counts` was measured
# Up to a wind in miles per hour: beta in s/m. Light air, breezy, windy, gale.
BETA = ((7.0, 12.0), (15.0, 8.0), (30.0, 5.7), (60.0, 4.3))


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


def foliage_velocity(
    wind_mph: float, radar: RadarSpec, time_s: float
) -> Callable[[int], Float[np.ndarray, " leaf"]] | None:
    """Return what draws the radial velocities of leaves in a frame; None without wind.

    The draws depend on the time only.
    """
    if not wind_mph:
        return None
    random = np.random.default_rng([round(1e6 * abs(time_s)), *b"wind"])
    rate = beta(wind_mph)
    moves = 1 / (1 + standing_ratio(wind_mph, radar.center_frequency_hz))

    def draw(count: int) -> Float[np.ndarray, " leaf"]:
        velocity = random.laplace(scale=1 / rate, size=count)
        return np.where(random.random(count) < moves, velocity, 0.0)

    return draw


def beta(wind_mph: float) -> float:
    """Return the decay of the spectrum over velocity in s/m."""
    return next((rate for most, rate in BETA if wind_mph <= most), BETA[-1][1])


def standing_ratio(wind_mph: float, frequency_hz: float) -> float:
    """Return the power of the standing part over that of the moving part, r."""
    return 489.8 * wind_mph**-1.55 * (frequency_hz / 1e9) ** -1.21
