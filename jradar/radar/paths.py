"""Paths from each antenna to near targets: where waves are spheres, not planes.

Antennas lie in one plane, x = 0. The origin, to which distances and angles refer, is
the mean of the mean transmitter and the mean receiver.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jradar.radar.sensor import RadarSpec


def antenna_places(radar: RadarSpec) -> list[np.ndarray]:
    """Return the places of tx and of rx in metres, `[antenna, 3]`, on the host.

    Columns count in the direction in which the path to a target on the left grows.
    """
    spacing = radar.spacing_wavelengths, radar.row_spacing_wavelengths
    scale = np.array(spacing) * radar.wavelength_m
    both = [np.array(p) * -scale for p in (radar.tx_positions, radar.rx_positions)]
    middle = (both[0].mean(0) + both[1].mean(0)) / 2
    return [np.pad(places - middle, ((0, 0), (1, 0))) for places in both]


def extra_paths(
    direction: Float[Array, "*batch 3"],
    distance_m: Float[Array, "*batch"],
    places: np.ndarray,
) -> tuple[Float[Array, "*batch antenna"], Float[Array, "*batch antenna"]]:
    """Return distances to antennas beyond the origin's, and beyond a plane wave's.

    `direction` is a unit vector. The difference of two nearly equal distances is taken
    without subtracting them.
    """
    far = distance_m[..., None]
    antennas = jnp.asarray(places, jnp.float32)
    plane = -jnp.matmul(direction, antennas.T, precision="highest")
    square = jnp.broadcast_to((antennas**2).sum(-1), plane.shape)
    change = 2 * far * plane + square
    extra = change / (jnp.sqrt(far**2 + change) + far)
    # sqrt(far^2 + change) = far + extra, hence the rest after the plane wave's.
    return extra, (square - extra**2) / (2 * far)
