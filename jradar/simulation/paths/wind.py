"""Leaves and branches that the wind moves: the spectrum of windblown clutter.

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

# Up to a wind in miles per hour: beta in s/m. Light air, breezy, windy, gale.
BETA = ((7.0, 12.0), (15.0, 8.0), (30.0, 5.7), (60.0, 4.3))


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
