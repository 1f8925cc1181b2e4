"""Detections to a point cloud: the paper's section III-A in one function."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float

from jradar.radar import cfar
from jradar.radar.calibration import compensate_tdm
from jradar.radar.direction import directions
from jradar.radar.peaks import parabola_offset
from jradar.radar.sensor import RadarSpec
from jradar.radar.spectrum import range_doppler
from jradar.types import PointCloud

DETECTORS = {
    "ca": cfar.ca_cfar,
    "go": cfar.go_cfar,
    "so": cfar.so_cfar,
    "os": cfar.os_cfar,
}
ANGLES = ("num_azimuth", "num_elevation", "flip_azimuth", "flip_elevation", "refine")
DETECTION = ("detector", "false_alarm_rate", "guard", "train", "remove_static")


class Echo(NamedTuple):
    """A peak of the range-Doppler map; range and velocity are those of its bin."""

    range_bin: int
    range_m: float
    doppler_bin: int
    velocity_mps: float
    azimuth_deg: float
    elevation_deg: float
    power_db: float
    snr_db: float


@functools.partial(jax.jit, static_argnames=("radar", "capacity", *DETECTION, *ANGLES))
def radar_points(
    cube: Complex[Array, "tx rx chirp sample"],
    radar: RadarSpec,
    *,
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
    way round. Raises ValueError for a cube that is not the radar's.
    """
    if cube.shape != radar.cube_shape:
        raise ValueError(
            f"cube has shape {cube.shape}, {radar.name} needs [tx, rx, chirp, sample] "
            f"= {radar.cube_shape}: one frame, or another radar?"
        )
    if detector not in DETECTORS:
        raise ValueError(f"{detector=}, expected one of {[*DETECTORS]}")
    spectrum, power = range_doppler(cube, remove_static=remove_static)
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
        capacity=capacity,
        num_azimuth=num_azimuth,
        num_elevation=num_elevation,
        flip_azimuth=flip_azimuth,
        flip_elevation=flip_elevation,
        refine=refine,
    )


@functools.partial(jax.jit, static_argnames=("radar", "capacity", *ANGLES))
def detections_to_points(
    spectrum: Complex[Array, "virtual doppler range"],
    power: Float[Array, "doppler range"],
    noise: Float[Array, "doppler range"],
    mask: Bool[Array, "doppler range"],
    radar: RadarSpec,
    *,
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
    num_doppler, num_range = power.shape
    candidates = jnp.where(mask, power, 0.0).at[:, 0].set(0.0).ravel()
    strongest, cell = jax.lax.top_k(candidates, min(capacity, candidates.size))
    padding = (0, capacity - cell.size)
    strongest, cell = jnp.pad(strongest, padding), jnp.pad(cell, padding)
    valid = strongest > 0

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

    snapshot = spectrum.reshape(radar.num_virtual, -1)[:, cell].T
    azimuth, elevation = directions(
        compensate_tdm(snapshot, doppler_bin, radar),
        radar,
        num_azimuth=num_azimuth,
        num_elevation=num_elevation,
        interpolate=refine,
        flip_azimuth=flip_azimuth,
        flip_elevation=flip_elevation,
    )
    distance = range_bin * radar.range_resolution_m
    ground = distance * jnp.cos(elevation)
    xyz = [
        ground * jnp.cos(azimuth),
        ground * jnp.sin(azimuth),
        distance * jnp.sin(elevation),
    ]
    snr = strongest / jnp.maximum(noise.ravel()[cell], 1e-30)
    return PointCloud(
        xyz=jnp.where(valid[:, None], jnp.stack(xyz, -1), 0.0),
        valid=valid,
        velocity=jnp.where(valid, doppler_bin * radar.velocity_resolution_mps, 0.0),
        power=strongest,
        snr=jnp.where(valid, snr, 0.0),
    )


def strongest_echoes(
    cloud: PointCloud,
    radar: RadarSpec,
    *,
    count: int = 5,
    min_range_m: float = 0.5,
    apart: int = 3,
) -> list[Echo]:
    """The strongest points that are no neighbours of stronger ones, on the host.

    Takes one cloud of `radar_points`. Neighbours lie within `apart` bins of each other
    in range and in velocity. What is nearer than `min_range_m` is left out: there the
    coupling of the antennas is the strongest echo.
    """
    valid = np.asarray(cloud.valid)
    measured = (cloud.xyz, cloud.velocity, cloud.power, cloud.snr)
    columns = (np.asarray(column)[valid] for column in measured)
    echoes: list[Echo] = []
    for xyz, velocity, power, snr in zip(*columns, strict=True):
        distance = float(np.linalg.norm(xyz))
        range_bin = round(distance / radar.range_resolution_m)
        doppler_bin = round(float(velocity) / radar.velocity_resolution_mps)
        echo = Echo(
            range_bin=range_bin,
            range_m=range_bin * radar.range_resolution_m,
            doppler_bin=doppler_bin,
            velocity_mps=doppler_bin * radar.velocity_resolution_mps,
            azimuth_deg=float(np.degrees(np.arctan2(xyz[1], xyz[0]))),
            elevation_deg=float(np.degrees(np.arcsin(xyz[2] / distance))),
            power_db=float(10 * np.log10(power)),
            snr_db=float(10 * np.log10(snr)),
        )
        neighbours = (
            abs(echo.range_bin - other.range_bin) <= apart
            and abs(echo.doppler_bin - other.doppler_bin) <= apart
            for other in echoes
        )
        if distance >= min_range_m and len(echoes) < count and not any(neighbours):
            echoes.append(echo)
    return echoes
