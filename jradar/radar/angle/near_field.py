"""Directions for wide arrays: true delays across the aperture, spherical waves.

Across an array as wide as a cascade's, what `directions` assumes does not hold:

    delays      towards the sides, the outer antennas are up to half a cell nearer or
                farther, so that a cell holds only part of their power
    curvature   within a few metres, the wave's front bends by more than a wavelength

`focused_directions` takes each antenna's value between three range cells at its own
distance, removes the curvature of a target at the found place, and searches again.
Transmitters and receivers are taken to lie at their `tx_positions` and `rx_positions`
in one plane with one origin; the point that angles refer to is the mean antenna. If the
board's transmitters and receivers are apart, give their positions accordingly.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int

from jradar.compiled import jit
from jradar.options.points import WINDOWS
from jradar.options.sensor import RadarSpec
from jradar.radar.angle.direction import directions
from jradar.radar.angle.spectrum import Angle

ROUNDS = 4  # of focusing and searching
CELLS = (-1, 0, 1)


@jit(static_argnames=("radar", "range_window", "num_azimuth", "num_elevation"))
def focused_directions(
    cells: Complex[Array, "*batch 3 virtual"],
    cell: Int[Array, "*batch"],
    offset: Float[Array, "*batch"],
    radar: RadarSpec,
    *,
    range_bias_m: Float[Array | np.ndarray, "..."] | float = 0.0,
    range_window: str = "hann",
    num_azimuth: int = 64,
    num_elevation: int = 32,
) -> tuple[Angle, Angle]:
    """Return azimuth and elevation in radians of a target in each snapshot.

    `cells` are the spectra, after `compensate_tdm`, of the range cells before, at and
    after `cell`; the target lies `offset` bins after it. Raises ValueError as
    `directions`.
    """
    options: Any = {"num_azimuth": num_azimuth, "num_elevation": num_elevation}
    distance = (cell + offset) * radar.range_resolution_m - range_bias_m
    azimuth, elevation = directions(cells[..., 1, :], radar, **options)
    for _ in range(ROUNDS):
        place = offset, distance, azimuth, elevation
        snapshot = focus(cells, *place, radar, range_window=range_window)
        azimuth, elevation = directions(snapshot, radar, **options)
    return azimuth, elevation


def focus(
    cells: Complex[Array, "*batch 3 virtual"],
    offset: Float[Array, "*batch"],
    distance_m: Float[Array, "*batch"],
    azimuth: Angle,
    elevation: Angle,
    radar: RadarSpec,
    *,
    range_window: str = "hann",
) -> Complex[Array, "*batch virtual"]:
    """Return the snapshot that a far target in the same direction would give.

    `offset` is the target's place in bins from the middle cell. The angles are those of
    a sensor that is not mounted upside down.
    """
    extra, curve = _paths(distance_m, azimuth, elevation, radar)
    place = offset[..., None] + extra / radar.range_resolution_m
    gain = jnp.stack([_main_lobe(place - cell, range_window) for cell in CELLS], -2)
    middle = (radar.num_samples - 1) / 2 / radar.num_samples
    turn = jnp.asarray(np.exp(2j * np.pi * middle * np.array(CELLS)), cells.dtype)
    turn = jnp.broadcast_to(turn[:, None], cells.shape)
    combined = (cells * gain * turn).sum(-2) / (gain**2).sum(-2)
    return combined * jnp.exp(-4j * jnp.pi * curve / radar.wavelength_m)


def _paths(distance, azimuth, elevation, radar):
    """Half of each pair's path minus the mean, and minus a plane wave's; metres."""
    direction = jnp.stack(
        [
            jnp.cos(elevation) * jnp.cos(azimuth),
            jnp.cos(elevation) * jnp.sin(azimuth),
            jnp.sin(elevation),
        ],
        -1,
    )
    far = jnp.maximum(distance, radar.range_resolution_m)[..., None]
    # Columns count in the direction in which the path to a target on the left grows.
    spacing = radar.spacing_wavelengths, radar.row_spacing_wavelengths
    scale = -radar.wavelength_m * np.array(spacing)
    places = [np.array(p) * scale for p in (radar.tx_positions, radar.rx_positions)]
    middle = (places[0].mean(0) + places[1].mean(0)) / 2
    (tx, tx_curve), (rx, rx_curve) = (
        _extra(direction, far, np.pad(antennas - middle, ((0, 0), (1, 0))))
        for antennas in places
    )
    extra = _pairs(tx, rx)
    return extra - extra.mean(-1, keepdims=True), _pairs(tx_curve, rx_curve)


def _extra(direction, far, places):
    """Distances to antennas minus the origin's, and minus a plane wave's."""
    antennas = jnp.asarray(places, jnp.float32)
    plane = -jnp.matmul(direction, antennas.T, precision="highest")
    square = jnp.broadcast_to((antennas**2).sum(-1), plane.shape)
    change = 2 * far * plane + square
    # Without subtracting two nearly equal distances.
    extra = change / (jnp.sqrt(far**2 + change) + far)
    # sqrt(far^2 + change) = far + extra, hence the rest after the plane wave's.
    return extra, (square - extra**2) / (2 * far)


def _pairs(tx, rx):
    """Half the sum for every pair of antennas, `[*batch, virtual]`."""
    both = (tx[..., :, None] + rx[..., None, :]) / 2
    return both.reshape(*both.shape[:-2], -1)


def _main_lobe(bins, kind):
    """The window's response `bins` away from a tone, 1 at the tone."""
    first, *others = WINDOWS[kind]
    total = first * jnp.sinc(bins)
    for k, coefficient in enumerate(others, 1):
        total += coefficient / 2 * (jnp.sinc(bins - k) + jnp.sinc(bins + k))
    return total / first
