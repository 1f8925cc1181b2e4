"""The strongest echoes of a frame, for people: a summary on the host."""

from typing import NamedTuple

import numpy as np

from jradar.radar.sensor import RadarSpec
from jradar.types import PointCloud


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
