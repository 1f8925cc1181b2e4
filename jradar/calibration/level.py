"""The tilt of an array from its own motion over level ground.

A phase error that grows along the rows of an array shifts the sine of all elevations,

    w measured = w + tilt

and no snapshot of an unknown direction contradicts it. The radar's motion does: a
radar that is carried ahead over level ground seems to climb or to sink, because the
Doppler of echoes that stand still gives its velocity in the shifted directions
(`ego_velocity`). In each frame the tilt is the shift that leaves no velocity along the
vertical. Steps and bumps average out over the frames.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from jradar.compiled import jit
from jradar.motion.doppler import ego_velocity
from jradar.motion.velocities import TO_DEVIATION
from jradar.options.sensor import RadarSpec
from jradar.types import PointCloud

LARGEST_DEG, STEP_DEG = 25.0, 1.0  # of the tilts that are tried
LEAST_SPEED_MPS = 0.2
LEAST_AHEAD = 0.5  # share of the speed along boresight, either way
LEAST_FRAMES = 5
NEAREST_AHEAD = 0.05  # squared cosine from boresight of the echoes that count
TINY = 1e-9
# Of a Gaussian: the deviation of n values' median over that of their mean.
OF_MEDIAN = np.sqrt(np.pi / 2)


class Tilt(NamedTuple):
    """The shift of all elevations' sines, its standard deviation, and the frames."""

    sine: float
    deviation: float
    frames: int

    @property
    def degrees(self) -> float:
        """The tilt in degrees."""
        return float(np.degrees(np.arcsin(min(self.sine, 1.0))))

    @property
    def deviation_deg(self) -> float:
        """Its standard deviation in degrees."""
        return float(np.degrees(np.arcsin(min(self.deviation, 1.0))))


def level_tilt(
    clouds: PointCloud,
    radar: RadarSpec,
    *,
    up: tuple[float, float, float] = (0.0, 0.0, 1.0),
) -> Tilt:
    """Return the tilt of the array from clouds `[frame, point]` with velocities; host.

    `up` is the vertical along the radar's axes. Raises ValueError for an array without
    elevation, and if fewer than five frames move ahead or back by 0.2 m/s or more.
    """
    if not radar.has_elevation:
        raise ValueError(
            f"{radar.name} has one row of antennas, expected more: a tilt is a phase "
            "between rows"
        )
    tilts = np.sin(np.radians(np.arange(-LARGEST_DEG, LARGEST_DEG + 1e-6, STEP_DEG)))
    vertical = jnp.asarray(up) / np.linalg.norm(up)
    climb, ahead, speed = (
        np.asarray(column)
        for column in _motion(jnp.asarray(tilts), clouds, vertical, radar)
    )
    crossing = [_crossing(tilts, column) for column in climb.T]
    middle = len(tilts) // 2
    used = np.isfinite(crossing) & (speed[middle] >= LEAST_SPEED_MPS)
    used &= np.abs(ahead[middle]) >= LEAST_AHEAD * speed[middle]
    if used.sum() < LEAST_FRAMES:
        raise ValueError(
            f"{used.sum()} of {len(used)} frames show the tilt, expected "
            f"{LEAST_FRAMES} or more: carry the radar ahead over level ground by "
            f"{LEAST_SPEED_MPS} m/s or more, among things that stand still"
        )
    found = np.array(crossing)[used]
    sine = float(np.median(found))
    spread = TO_DEVIATION * float(np.median(np.abs(found - sine)))
    return Tilt(sine, float(OF_MEDIAN * spread / np.sqrt(len(found))), len(found))


def untilted(sine: float, radar: RadarSpec) -> Complex[np.ndarray, " virtual"]:
    """Return factors of the channels that undo a tilt of this sine; host."""
    rows = radar.virtual_positions[:, 1]
    return np.exp(-2j * np.pi * radar.row_spacing_wavelengths * sine * rows)


@jit(static_argnames="radar")
def _motion(
    tilts: Float[Array, " tilt"],
    clouds: PointCloud,
    up: Float[Array, " 3"],
    radar: RadarSpec,
):
    """Velocity along the vertical and ahead, and speed, `[tilt, frame]`."""

    def of_frame(tilt, cloud):
        distance = jnp.linalg.norm(cloud.xyz, axis=-1)
        _, u, w = (cloud.xyz / jnp.maximum(distance, TINY)[:, None]).T
        square = 1 - u**2 - (w - tilt) ** 2
        ahead = jnp.sqrt(jnp.maximum(square, NEAREST_AHEAD))
        shifted = cloud._replace(
            xyz=distance[:, None] * jnp.stack([ahead, u, w - tilt], -1),
            valid=cloud.valid & (square > NEAREST_AHEAD),
        )
        return ego_velocity(
            jax.random.key(0), shifted, unambiguous_mps=radar.max_velocity_mps, folds=0
        ).velocity

    frames = jax.vmap(of_frame, (None, 0))
    velocity = jax.lax.map(lambda tilt: frames(tilt, clouds), tilts)
    return velocity @ up, velocity[..., 0], jnp.linalg.norm(velocity, axis=-1)


def _crossing(x, y):
    """Where y changes its sign, the middle one of several places; NaN without any."""
    change = np.flatnonzero(np.sign(y[:-1]) * np.sign(y[1:]) < 0)
    places = x[change] - y[change] * np.diff(x)[change] / np.diff(y)[change]
    return float(np.median(places)) if len(places) else np.nan
