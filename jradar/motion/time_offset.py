r"""The offset between the clocks of radar and LiDAR, from motion that both measured.

Files of ADC samples contain no times, so the radar's stamps may be off by seconds. The
motion that each sensor measured rises and falls at the same moments:

    radar    ___/\____/'\___          The offset is where the two correlate best. The
    LiDAR        ___/\____/'\___      lead of this peak over the next one is the
             ->|   |<- offset         confidence.

The radar's motion is its own velocity, by Doppler. With poses on the LiDAR's clock it
is compared with theirs, forward and sideways. Without poses, its speed is compared with
how fast the ranges of the clouds change. Rotation changes them, too, so fewer offsets
stand out.
"""

import itertools
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jradar.lidar import interpolate_poses
from jradar.motion.velocities import frame_velocities, outliers
from jradar.recordings import Recording

MAX_OFFSET_S = 5.0
MAX_FRAMES, MAX_CLOUDS = 200, 400
PERIOD_S = 0.1  # shortest time between two measurements of motion
SECTORS = (72, 18)  # cells of azimuth x elevation whose mean ranges are compared
MOST_STEPS = 100_000  # of the common clock
LEAST_OVERLAP = 0.5  # of the shorter signal, at any offset
FEWEST = 8  # measurements of each sensor

Motion = Float[np.ndarray, "time component"]


class TimeOffset(NamedTuple):
    """The seconds to add to the radar's stamps, and the evidence for them."""

    seconds: float
    confidence: float  # 0 to 1: the lead over the next best offset
    compared_with: str  # "poses" or "clouds"


def estimate_time_offset(
    radar_stamps: Float[np.ndarray, " frame"],
    radar_motion: Motion,
    lidar_stamps: Float[np.ndarray, " cloud"],
    lidar_motion: Motion,
) -> tuple[float, float]:
    """Return the seconds to add to the radar's stamps, and the confidence, 0 to 1.

    The signals, of as many components each, are resampled to half the finer period and
    cross-correlated; a parabola through the peak refines it. The confidence is the
    correlation at the peak minus that at the next peak. Raises ValueError for fewer
    than 8 samples and for stamps that do not rise, or have gaps of days.
    """
    if min(len(radar_stamps), len(lidar_stamps)) < FEWEST:
        raise ValueError(
            f"{len(radar_stamps)} measurements of the radar's motion and "
            f"{len(lidar_stamps)} of the LiDAR's, expected {FEWEST} or more of each"
        )
    radar_steps, lidar_steps = np.diff(radar_stamps), np.diff(lidar_stamps)
    if not (radar_steps > 0).all() or not (lidar_steps > 0).all():
        raise ValueError("stamps fall or repeat, expected rising ones")
    step = 0.5 * float(min(np.median(radar_steps), np.median(lidar_steps)))
    span = max(np.ptp(lidar_stamps), MAX_OFFSET_S)
    if span > MOST_STEPS * step:
        raise ValueError(
            f"stamps every {2 * step:g} s span {span:g} s, expected at most "
            f"{MOST_STEPS:,} half steps: are they in seconds?"
        )
    least = LEAST_OVERLAP * min(np.ptp(radar_stamps), np.ptp(lidar_stamps)) / step
    clock = np.arange(lidar_stamps[0], lidar_stamps[-1], step)
    lidar = _resampled(clock, lidar_stamps, lidar_motion)
    reach = int(np.ceil(MAX_OFFSET_S / step))
    offsets = np.arange(-reach, reach + 1) * step
    correlation = np.zeros(len(offsets))
    for at, offset in enumerate(offsets):
        there = clock - offset  # on the radar's clock
        both = (there >= radar_stamps[0]) & (there <= radar_stamps[-1])
        if both.sum() >= least:
            radar = _resampled(there[both], radar_stamps, radar_motion)
            correlation[at] = _correlation(radar, lidar[both])
    peak, shift = int(correlation.argmax()), 0.0
    if 0 < peak < len(offsets) - 1:
        left, top, right = correlation[peak - 1 : peak + 2]
        bend = left - 2 * top + right
        shift = 0.5 * (left - right) / bend if bend < 0 else 0.0
    steps = np.diff(np.pad(correlation, 1, constant_values=-1))
    tops = (steps[:-1] > 0) & (steps[1:] < 0)
    tops[peak] = False
    next_peak = correlation[tops].max(initial=0.0)
    confidence = max(correlation[peak] - next_peak, 0.0)
    return float(offsets[peak] + shift * step), float(confidence)


def propose_offset(recording: Recording) -> TimeOffset:
    """Return the offset of a recording, from the motion in its first 20 seconds; host.

    Raises ValueError where stamps, or poses and LiDAR, are missing, for too few of
    them, and for a radar that `frame_velocities` refuses.
    """
    stamps, scans, poses = recording.cubes.stamps, recording.lidar, recording.poses
    timed = scans is not None and scans.stamps is not None
    if stamps is None or (poses is None and not timed):
        raise ValueError(
            f"{recording.name}: expected times of the radar's frames, and poses or a "
            "LiDAR with times"
        )
    frames = _chosen(stamps, -np.inf, np.inf)[:MAX_FRAMES]
    velocities = frame_velocities(recording, frames=[int(i) for i in frames])
    known = np.isfinite(velocities.velocity).all(1) & ~outliers(velocities)
    times, ground = velocities.stamps[known], velocities.velocity[known, :2]
    near = (stamps[0] - MAX_OFFSET_S, stamps[frames[-1]] + MAX_OFFSET_S)
    if poses is None:
        speed = np.linalg.norm(ground, axis=1, keepdims=True)
        found = estimate_time_offset(times, speed, *_lidar_motion(scans, *near))
        return TimeOffset(*found, "clouds")
    moved = _pose_motion(poses, recording.base_from_radar, *near)
    return TimeOffset(*estimate_time_offset(times, ground, *moved), "poses")


def _pose_motion(poses, base_from_radar, first, last):
    """Return times, and the radar's velocity forward and to the left by its poses."""
    chosen = _several(poses.stamps, first, last, "poses")
    stamps = poses.stamps[chosen]
    mount = np.eye(4) if base_from_radar is None else base_from_radar
    world_from_radar = interpolate_poses(poses, stamps) @ mount
    step = np.diff(world_from_radar[:, :3, 3], axis=0) / np.diff(stamps)[:, None]
    along_axes = np.einsum("nji,nj->ni", world_from_radar[:-1, :3, :3], step)
    return 0.5 * (stamps[1:] + stamps[:-1]), along_axes[:, :2]


def _lidar_motion(clouds, first, last):
    """Return times, and how fast the ranges of clouds change, in m/s."""
    chosen = _several(clouds.stamps, first, last, "clouds")[:MAX_CLOUDS]
    stamps = clouds.stamps[chosen]
    pairs = itertools.pairwise(clouds[int(index)] for index in chosen)
    change = np.array([_lidar_change(*pair) for pair in pairs])
    speed = change / np.maximum(np.diff(stamps), 1e-6)
    return 0.5 * (stamps[1:] + stamps[:-1]), speed[:, None]


def _several(stamps, first, last, what):
    """Return `_chosen`; ValueError for too few."""
    chosen = _chosen(stamps, first, last)
    if len(chosen) <= FEWEST:
        raise ValueError(
            f"{len(chosen)} {what} within {MAX_OFFSET_S:g} s of the radar's frames, "
            f"expected more than {FEWEST}"
        )
    return chosen


def _chosen(stamps, first, last):
    """Return the indices of items from `first` to `last`, `PERIOD_S` apart."""
    inside = np.flatnonzero((stamps >= first) & (stamps <= last))
    if len(inside) < 2:
        return inside
    period = float(np.median(np.diff(stamps[inside])))
    return inside[:: max(round(PERIOD_S / max(period, 1e-9)), 1)]


def _lidar_change(before, after):
    """Return the median change of mean range, in metres, over cells seen twice."""
    a, b = _mean_ranges(before), _mean_ranges(after)
    seen = np.isfinite(a) & np.isfinite(b)
    return float(np.median(np.abs(a - b)[seen])) if seen.any() else 0.0


def _mean_ranges(cloud):
    """Return the mean range in each direction cell, NaN in empty ones."""
    xyz = cloud[:, :3].astype(float)
    ranges = np.linalg.norm(xyz, axis=1)
    azimuth = np.arctan2(xyz[:, 1], xyz[:, 0])
    elevation = np.arcsin(np.clip(xyz[:, 2] / np.maximum(ranges, 1e-9), -1, 1))
    cells = {"bins": SECTORS, "range": np.outer([1, 0.5], [-np.pi, np.pi])}
    sums, *_ = np.histogram2d(azimuth, elevation, weights=ranges, **cells)
    counts, *_ = np.histogram2d(azimuth, elevation, **cells)
    with np.errstate(invalid="ignore"):
        return sums / counts


def _resampled(times, stamps, motion):
    """Return the components of motion at other times."""
    return np.stack([np.interp(times, stamps, part) for part in motion.T], -1)


def _correlation(a, b):
    """Return Pearson's correlation over all components; 0 if a signal is constant."""
    a, b = a - a.mean(0), b - b.mean(0)
    scale = np.sqrt((a * a).sum() * (b * b).sum())
    return (a * b).sum() / scale if scale > 1e-12 else 0.0
