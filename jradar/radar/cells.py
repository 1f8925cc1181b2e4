"""Every cell of a range-Doppler map with its direction: a frame before detection.

    cube --all_cells--> Cells --cell_points(mask)--> PointCloud

`radar_points` finds the directions of the cells that it detects. `all_cells` finds
those of all cells once, and any detector, with a threshold or learned, is then a mask
over the map: `cell_points` of `radar_points`' mask are the points of `radar_points`.
Where a peak lies between the bins of range and velocity follows from the power map, and
is found with the points.
"""

import functools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Complex, Float, Int

from jradar.radar import cfar
from jradar.radar.calibration import compensate_tdm, subtract_coupling
from jradar.radar.direction import directions
from jradar.radar.peaks import parabola_offset
from jradar.radar.sensor import RadarSpec
from jradar.radar.spectrum import range_doppler
from jradar.radar.subspace import music_directions
from jradar.types import PointCloud

ANGLES = ("num_azimuth", "num_elevation", "flip_azimuth", "flip_elevation", "refine")
METHODS = ("fft", "music")  # to find directions
WRAPPED = 2  # range bins behind bin 0 that a window's main lobe reaches
Map = Float[Array, "doppler range"]
Spectrum = Complex[Array, "virtual doppler range"]
Values = Float[Array, " point"]


class Cells(NamedTuple):
    """Power, summed over antennas, and strongest direction in radians of each cell."""

    power: Float[Array, "*batch doppler range"]
    azimuth: Float[Array, "*batch doppler range"]
    elevation: Float[Array, "*batch doppler range"]


@functools.partial(
    jax.jit, static_argnames=("radar", "method", "remove_static", *ANGLES)
)
def all_cells(
    cube: Complex[Array, "tx rx chirp sample"],
    radar: RadarSpec,
    *,
    coupling: Complex[Array, "tx rx half_range"] | None = None,
    num_azimuth: int = 64,
    num_elevation: int = 32,
    flip_azimuth: bool = False,
    flip_elevation: bool = False,
    refine: bool = True,
    remove_static: bool = False,
    method: str = "fft",
) -> Cells:
    """All cells of one frame, with the options of `radar_points`; `vmap` it.

    `refine` places directions between bins. The `method` "music" finds azimuths by
    `music_directions`, which has bins of its own. Raises ValueError for a cube that is
    not the radar's.
    """
    if method not in METHODS:
        raise ValueError(f"{method=} for directions, expected one of {METHODS}")
    spectrum, power = spectra(cube, radar, coupling, remove_static)
    _, doppler_bin = bins_of(power, jnp.arange(power.size), refine)
    snapshot = spectrum.reshape(radar.num_virtual, -1).T
    snapshot = compensate_tdm(snapshot, doppler_bin, radar)
    flips = {"flip_azimuth": flip_azimuth, "flip_elevation": flip_elevation}
    if method == "music":
        azimuth, elevation = music_directions(snapshot, radar, **flips)
    else:
        azimuth, elevation = directions(
            snapshot,
            radar,
            num_azimuth=num_azimuth,
            num_elevation=num_elevation,
            interpolate=refine,
            **flips,
        )
    return Cells(power, azimuth.reshape(power.shape), elevation.reshape(power.shape))


@functools.partial(
    jax.jit,
    static_argnames=("radar", "capacity", "guard", "train", "refine", "range_bias_m"),
)
def cell_points(
    cells: Cells,
    mask: Bool[Array, "doppler range"],
    radar: RadarSpec,
    *,
    capacity: int = 1024,
    guard: tuple[int, int] = (2, 2),
    train: tuple[int, int] = (4, 4),
    refine: bool = True,
    range_bias_m: float = 0.0,
) -> PointCloud:
    """Points of the cells in `mask`, strongest first, padded to `capacity`.

    One frame; `vmap` it. The SNR is to the mean of the training cells in the window of
    `guard` and `train`, in (doppler, range) cells.
    """
    power, cell = strongest_cells(cells.power, mask, radar, capacity, range_bias_m)
    range_bin, doppler_bin = bins_of(cells.power, cell, refine)
    return cloud(
        range_bin * radar.range_resolution_m - range_bias_m,
        doppler_bin * radar.velocity_resolution_mps,
        cells.azimuth.ravel()[cell],
        cells.elevation.ravel()[cell],
        power,
        cfar.noise_floor(cells.power, guard=guard, train=train).ravel()[cell],
    )


def spectra(
    cube: Complex[Array, "tx rx chirp sample"],
    radar: RadarSpec,
    coupling: Complex[Array, "tx rx half_range"] | None,
    remove_static: bool,
) -> tuple[Spectrum, Map]:
    """`range_doppler`, less the coupling where there is one.

    `remove_static` removes the coupling with all else that is steady. Raises ValueError
    for a cube that is not the radar's.
    """
    if cube.shape != radar.cube_shape:
        raise ValueError(
            f"cube has shape {cube.shape}, {radar.name} needs [tx, rx, chirp, sample] "
            f"= {radar.cube_shape}: one frame, or another radar?"
        )
    if coupling is None or remove_static:
        return range_doppler(cube, remove_static=remove_static)
    spectrum, _ = range_doppler(cube, range_window="blackman")
    spectrum = subtract_coupling(spectrum, coupling)
    return spectrum, (spectrum.real**2 + spectrum.imag**2).sum(0)


def strongest_cells(
    power: Map,
    mask: Bool[Array, "doppler range"],
    radar: RadarSpec,
    capacity: int,
    range_bias_m: float,
) -> tuple[Values, Int[Array, " point"]]:
    """Power and flat index of the strongest cells in `mask`; 0 where there is none.

    Range bin 0, the sensor itself, is never one, nor what the bias puts there, nor the
    last two bins, into which its window spreads the leakage of the antennas.
    """
    first = max(1, math.floor(range_bias_m / radar.range_resolution_m + 0.5) + 1)
    candidates = jnp.where(mask, power, 0.0).at[:, :first].set(0.0)
    candidates = candidates.at[:, -WRAPPED:].set(0.0).ravel()
    strongest, cell = jax.lax.top_k(candidates, min(capacity, candidates.size))
    padding = (0, capacity - cell.size)
    return jnp.pad(strongest, padding), jnp.pad(cell, padding)


def bins_of(
    power: Map, cell: Int[Array, " point"], refine: bool
) -> tuple[Values, Values]:
    """Range bin and signed Doppler bin of flat cells; `refine` places between bins."""
    num_doppler, num_range = power.shape
    row, column = jnp.divmod(cell, num_range)
    doppler_bin = (row - num_doppler // 2).astype(power.dtype)
    range_bin = column.astype(power.dtype)
    if refine:
        left, right = jnp.maximum(column - 1, 0), jnp.minimum(column + 1, num_range - 1)
        range_bin += parabola_offset(
            power[row, left], power[row, column], power[row, right]
        )
    if refine and num_doppler > 2:
        below, above = (row - 1) % num_doppler, (row + 1) % num_doppler
        doppler_bin += parabola_offset(
            power[below, column], power[row, column], power[above, column]
        )
    return range_bin, doppler_bin


def cloud(
    distance: Values,
    velocity: Values,
    azimuth: Values,
    elevation: Values,
    power: Values,
    noise: Values,
) -> PointCloud:
    """The cloud of what was measured; points without power are padding."""
    valid = power > 0
    ground = distance * jnp.cos(elevation)
    xyz = [
        ground * jnp.cos(azimuth),
        ground * jnp.sin(azimuth),
        distance * jnp.sin(elevation),
    ]
    return PointCloud(
        xyz=jnp.where(valid[:, None], jnp.stack(xyz, -1), 0.0),
        valid=valid,
        velocity=jnp.where(valid, velocity, 0.0),
        power=power,
        snr=jnp.where(valid, power / jnp.maximum(noise, 1e-30), 0.0),
    )
