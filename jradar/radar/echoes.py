"""The strongest echoes and the noise of a frame as a readable summary, on the host."""

from typing import NamedTuple

import numpy as np
import scipy  # loads `special` when it is first used
from jax.typing import ArrayLike
from jaxtyping import Float

from jradar.options.sensor import RadarSpec
from jradar.radar.spectrum import window
from jradar.types import PointCloud

MIN_RANGE_M = 0.5  # the coupling of the antennas is the strongest echo below it
NEIGHBOURS = 3  # bins
MOST = 5


class Echo(NamedTuple):
    """A peak of the range-Doppler map, with the range and velocity of its bin."""

    range_bin: int
    range_m: float
    doppler_bin: int
    velocity_mps: float
    azimuth_deg: float
    elevation_deg: float
    power_db: float
    snr_db: float


def strongest_echoes(cloud: PointCloud, radar: RadarSpec) -> list[Echo]:
    """Return the `MOST` strongest echoes of a `radar_points` cloud, on the host.

    A point is omitted if a stronger echo lies within `NEIGHBOURS` bins of it in range
    and velocity, or if it is nearer than `MIN_RANGE_M`.
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
            abs(echo.range_bin - other.range_bin) <= NEIGHBOURS
            and abs(echo.doppler_bin - other.doppler_bin) <= NEIGHBOURS
            for other in echoes
        )
        if distance >= MIN_RANGE_M and len(echoes) < MOST and not any(neighbours):
            echoes.append(echo)
    return echoes


class NoiseStatistics(NamedTuple):
    """The level and spread of a range-Doppler map whose cells mostly hold noise.

    The spread is half the distance from the 16th to the 84th percentile. A map whose
    spread is well above that of pure noise is full of echoes, leakage or interference.
    """

    floor_db: float  # the median cell, as `Echo.power_db`
    spread_db: float
    pure_noise_spread_db: float
    counts_per_sample: float  # root mean square of the noise in an ADC sample


def noise_statistics(
    power: Float[ArrayLike, "doppler range"], radar: RadarSpec
) -> NoiseStatistics:
    """Return the level and spread of a `power_map` with its default windows.

    In pure noise, the power summed over antennas follows a gamma distribution. For a
    map of zeros everything is 0, except the spread of pure noise.
    """
    low, middle, high = np.percentile(np.asarray(power, np.float64), (16, 50, 84))
    of_noise = scipy.special.gammaincinv(radar.num_virtual, (0.16, 0.5, 0.84))
    weight = (window("hann", size) for size in (radar.num_chirps, radar.num_samples))
    gain = np.prod([np.sum(values**2) for values in weight])
    return NoiseStatistics(
        floor_db=float(10 * np.log10(middle)) if middle > 0 else 0.0,
        spread_db=float(5 * np.log10(high / low)) if low > 0 else 0.0,
        pure_noise_spread_db=float(5 * np.log10(of_noise[2] / of_noise[0])),
        counts_per_sample=float(np.sqrt(middle / of_noise[1] / gain)),
    )
