"""Detections to a point cloud: the paper's section III-A in one function."""

import functools

import jax
from jaxtyping import Array, Bool, Complex, Float

from jradar.radar import cells, cfar
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
PLACES = ("radar", "capacity", "range_bias_m", *ANGLES)


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
    way round. `coupling` is what `read_coupling` reads, and has the spectra made with
    the window that it asks for; `range_bias_m` is subtracted from ranges; channels are
    calibrated beforehand, on the cube. Raises ValueError for a cube that is not the
    radar's.
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
    azimuth, elevation = directions(
        cells.snapshots(spectrum, cell, doppler_bin, radar),
        radar,
        num_azimuth=num_azimuth,
        num_elevation=num_elevation,
        interpolate=refine,
        flip_azimuth=flip_azimuth,
        flip_elevation=flip_elevation,
    )
    return cells.cloud(
        range_bin * radar.range_resolution_m - range_bias_m,
        doppler_bin * radar.velocity_resolution_mps,
        azimuth,
        elevation,
        strongest,
        noise.ravel()[cell],
    )
