"""Detections to a point cloud: the paper's section III-A in one function."""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Complex, Float, Int

from jradar.radar import cells, cfar
from jradar.radar.angle import Peaks, angle_spectrum, spectrum_peaks
from jradar.radar.calibration import compensate_tdm
from jradar.radar.cells import ANGLES
from jradar.radar.direction import directions
from jradar.radar.sensor import RadarSpec
from jradar.types import PointCloud

DETECTORS = {
    "ca": cfar.ca_cfar,
    "go": cfar.go_cfar,
    "so": cfar.so_cfar,
    "os": cfar.os_cfar,
}
DETECTION = ("detector", "false_alarm_rate", "guard", "train", "remove_static")
PLACES = ("radar", "capacity", "peaks", "range_bias_m", *ANGLES)
SPECTRA = 64  # angle spectra that are held at a time


@functools.partial(jax.jit, static_argnames=(*PLACES, *DETECTION))
def radar_points(
    cube: Complex[Array, "tx rx chirp sample"],
    radar: RadarSpec,
    *,
    coupling: Complex[Array, "tx rx half_range"] | None = None,
    range_bias_m: float = 0.0,
    capacity: int = 1024,
    detector: str = "os",
    false_alarm_rate: float = 1e-3,
    guard: tuple[int, int] = (2, 2),
    train: tuple[int, int] = (4, 4),
    peaks: int = 1,
    num_azimuth: int = 64,
    num_elevation: int = 32,
    flip_azimuth: bool = False,
    flip_elevation: bool = False,
    refine: bool = True,
    remove_static: bool = False,
) -> PointCloud:
    """The `capacity` strongest detections of one frame, strongest first.

    One frame; `vmap` it. A cell is detected on the power summed over antennas by the
    CFAR `detector` ("ca", "go", "so" or "os"), with its window in (doppler, range)
    cells; its angles come from the same cell across antennas. Velocity is in m/s, power
    in ADC counts squared, SNR the power over the mean of the training cells. `refine`
    places range, velocity and angles between bins. Elevation is 0 for an array with one
    row. `flip_azimuth` and `flip_elevation` are for a sensor that is mounted the other
    way round.

    `peaks` is how many targets a cell may show, each a point of its own, with power and
    SNR in proportion to its peak among the cell's `spectrum_peaks`. `coupling` is what
    `read_coupling` reads, and has the spectra made with the window that it asks for;
    `range_bias_m` is subtracted from ranges; channels are calibrated beforehand, on the
    cube. Raises ValueError for a cube that is not the radar's.
    """
    if detector not in DETECTORS:
        raise ValueError(f"{detector=}, expected one of {[*DETECTORS]}")
    spectrum, power = cells.spectra(cube, radar, coupling, remove_static)
    mask = DETECTORS[detector](
        power,
        false_alarm_rate=false_alarm_rate,
        channels=radar.num_virtual,
        guard=guard,
        train=train,
    )
    noise = cfar.noise_floor(power, guard=guard, train=train)
    return detections_to_points(
        spectrum,
        power,
        noise,
        mask,
        radar,
        range_bias_m=range_bias_m,
        capacity=capacity,
        peaks=peaks,
        num_azimuth=num_azimuth,
        num_elevation=num_elevation,
        flip_azimuth=flip_azimuth,
        flip_elevation=flip_elevation,
        refine=refine,
    )


@functools.partial(jax.jit, static_argnames=PLACES)
def detections_to_points(
    spectrum: Complex[Array, "virtual doppler range"],
    power: Float[Array, "doppler range"],
    noise: Float[Array, "doppler range"],
    mask: Bool[Array, "doppler range"],
    radar: RadarSpec,
    *,
    range_bias_m: float = 0.0,
    capacity: int = 1024,
    peaks: int = 1,
    num_azimuth: int = 64,
    num_elevation: int = 32,
    flip_azimuth: bool = False,
    flip_elevation: bool = False,
    refine: bool = True,
) -> PointCloud:
    """Points of the cells in `mask`, strongest first, padded to `capacity`.

    One frame; `vmap` it. Range bin 0, the sensor itself, is never a point.
    """
    strongest, cell = cells.strongest_cells(power, mask, radar, capacity, range_bias_m)
    range_bin, doppler_bin = cells.bins_of(power, cell, refine)
    snapshot = spectrum.reshape(radar.num_virtual, -1)[:, cell].T
    snapshot = compensate_tdm(snapshot, doppler_bin, radar)
    bins = {"num_azimuth": num_azimuth, "num_elevation": num_elevation}
    options = {
        "interpolate": refine,
        "flip_azimuth": flip_azimuth,
        "flip_elevation": flip_elevation,
    }
    floor = noise.ravel()[cell]
    if peaks == 1:
        azimuth, elevation = directions(snapshot, radar, **bins, **options)
    else:
        found = jax.lax.map(
            lambda snapshot: spectrum_peaks(
                angle_spectrum(snapshot, radar, **bins), radar, count=peaks, **options
            ),
            snapshot,
            batch_size=SPECTRA,
        )
        strongest, azimuth, elevation, of = _strongest_peaks(strongest, found, capacity)
        range_bin, doppler_bin, floor = range_bin[of], doppler_bin[of], floor[of]
    return cells.cloud(
        range_bin * radar.range_resolution_m - range_bias_m,
        doppler_bin * radar.velocity_resolution_mps,
        azimuth,
        elevation,
        strongest,
        floor,
    )


def _strongest_peaks(
    power: Float[Array, " cell"], found: Peaks, capacity: int
) -> tuple[Array, Array, Array, Int[Array, " point"]]:
    """Power, azimuth, elevation and cell of the strongest peaks of all cells.

    A cell's first peak has the cell's power, so that no weaker cell has one to add.
    """
    share = found.power / jnp.maximum(found.power[:, :1], 1e-30)
    powers = jnp.where(found.valid, power[:, None] * share, 0.0)
    strongest, peak = jax.lax.top_k(powers.ravel(), capacity)
    azimuth, elevation = found.azimuth.ravel()[peak], found.elevation.ravel()[peak]
    return strongest, azimuth, elevation, peak // found.power.shape[-1]
