"""What RPDNet is trained on: maps of power, and the cells that the LiDAR confirms.

A static point in direction d, seen by a radar that moves with velocity v, recedes with

    -d . v

so that its range and the platform's motion say in which cell of the range-Doppler map
it must appear. A cell is valid where a LiDAR point falls into it or into one beside it,
which the main lobe of the windows reaches, and where the power stands out of the noise.
Cheng et al. (2022) label by LiDAR too, but their code for it was not published: this is
ours. All of it runs on the host.
"""

import numpy as np
from jaxtyping import Bool, Float

from jradar.radar import RadarSpec

MAX_GAP_S = 0.3  # between poses that a velocity is derived from
DYNAMIC_RANGE_DB = 80.0  # weaker cells than this below the strongest are as weak as it


def map_values(
    power: Float[np.ndarray, "doppler range"],
) -> Float[np.ndarray, "doppler range"]:
    """A map of power in decibels, scaled to 0 .. 1 by its own least and largest."""
    floor = max(float(power.max()) * 10 ** (-DYNAMIC_RANGE_DB / 10), 1e-30)
    decibels = 10 * np.log10(np.maximum(power, floor))
    low, high = decibels.min(), decibels.max()
    return ((decibels - low) / max(high - low, 1e-6)).astype(np.float32)


def label_cells(
    lidar_xyz: Float[np.ndarray, "point 3"],
    velocity: Float[np.ndarray, " 3"],
    power: Float[np.ndarray, "doppler range"],
    radar: RadarSpec,
    *,
    min_snr_db: float = 3.0,
    range_bias_m: float = 0.0,
) -> Bool[np.ndarray, "doppler range"]:
    """Cells at a LiDAR point whose power is `min_snr_db` above the map's median.

    Points and the radar's own velocity in m/s are in the radar's frame. Velocities that
    the radar cannot tell apart share a cell; points beyond its range have none. With
    noise of 12 antennas, 3 dB is exceeded by 2 cells in 1000. Ranges are measured
    `range_bias_m` too long.
    """
    num_doppler, num_range = power.shape
    distance = np.linalg.norm(lidar_xyz, axis=-1)
    known = distance > 0
    distance, xyz = distance[known], lidar_xyz[known]
    receding = -(xyz @ velocity) / distance
    column = np.rint((distance + range_bias_m) / radar.range_resolution_m).astype(int)
    row = np.rint(receding / radar.velocity_resolution_mps).astype(int)
    row = (row + num_doppler // 2) % num_doppler
    inside = column < num_range
    label = np.zeros(power.shape, bool)
    label[row[inside], column[inside]] = True
    label |= np.roll(label, 1, 0) | np.roll(label, -1, 0)
    label[:, 1:-1] |= label[:, 2:] | label[:, :-2]
    return label & (power > np.median(power) * 10 ** (min_snr_db / 10))


def sensor_velocities(
    stamps: Float[np.ndarray, " frame"],
    world_from_sensor: Float[np.ndarray, "frame 4 4"],
) -> Float[np.ndarray, "frame 3"]:
    """Velocity of a sensor in its own frame from its poses in the order of time, m/s.

    The mean of the motion from the frame before and to the frame after; NaN where both
    are more than 0.3 s away or have no pose.
    """
    gap = np.diff(stamps)[:, None]
    steps = np.diff(world_from_sensor[:, :3, 3], axis=0)
    near = (gap > 0) & (gap <= MAX_GAP_S)
    steps = np.where(near, steps / np.where(near, gap, 1.0), np.nan)
    nothing = np.full((1, 3), np.nan)
    both = np.stack([np.r_[nothing, steps], np.r_[steps, nothing]])
    count = np.isfinite(both).sum(0)
    total = np.where(np.isfinite(both), both, 0.0).sum(0)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return np.einsum("nij,ni->nj", world_from_sensor[:, :3, :3], mean)
