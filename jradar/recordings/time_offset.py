r"""The offset between the clocks of radar and LiDAR, from motion that both measured.

Files of ADC samples contain no times, so the radar's stamps may be off by seconds. The
speed of the scene, measured by each sensor, rises and falls at the same moments:

    radar    ___/\____/'\___          The offset is where the two correlate best. The
    LiDAR        ___/\____/'\___      lead of this peak over the next one is the
             ->|   |<- offset         confidence.
"""

import itertools

import numpy as np
from jaxtyping import Complex, Float

from jradar.radar import RadarSpec
from jradar.recordings.recording import Recording

MAX_OFFSET_S = 5.0
MAX_FRAMES, MAX_CLOUDS = 200, 400
PERIOD_S = 0.1  # shortest time between two measurements of motion
SECTORS = (72, 18)  # cells of azimuth x elevation whose mean ranges are compared
MOST_STEPS = 100_000  # of the common clock
LEAST_OVERLAP = 0.5  # of the shorter signal, at any offset


def estimate_time_offset(
    radar_stamps: Float[np.ndarray, " frame"],
    radar_motion: Float[np.ndarray, " frame"],
    lidar_stamps: Float[np.ndarray, " cloud"],
    lidar_motion: Float[np.ndarray, " cloud"],
) -> tuple[float, float]:
    """Return the seconds to add to the radar's stamps, and the confidence, 0 to 1.

    The signals are resampled to half the finer period and cross-correlated; a parabola
    through the peak refines it. The confidence is the correlation at the peak minus
    that at the next peak. Raises ValueError for fewer than 8 samples and for stamps
    that do not rise, or have gaps of days.
    """
    if min(len(radar_stamps), len(lidar_stamps)) < 8:
        raise ValueError(
            f"{len(radar_stamps)} radar frames and {len(lidar_stamps)} clouds, "
            "expected 8 or more of each to compare their motion"
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
    lidar = np.interp(clock, lidar_stamps, lidar_motion)
    reach = int(np.ceil(MAX_OFFSET_S / step))
    offsets = np.arange(-reach, reach + 1) * step
    correlation = np.zeros(len(offsets))
    for at, offset in enumerate(offsets):
        there = clock - offset  # on the radar's clock
        both = (there >= radar_stamps[0]) & (there <= radar_stamps[-1])
        if both.sum() >= least:
            radar = np.interp(there[both], radar_stamps, radar_motion)
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


def propose_offset(recording: Recording) -> tuple[float, float]:
    """Return `estimate_time_offset` of a recording, from a few hundred frames.

    Raises ValueError if the recording has no LiDAR or no stamps, or is too short.
    """
    cubes, clouds = recording.cubes, recording.lidar
    if clouds is None or clouds.stamps is None or cubes.stamps is None:
        raise ValueError(f"{recording.name}: LiDAR and radar both need stamps")
    frames = _chosen(cubes.stamps, -np.inf, np.inf)[:MAX_FRAMES]
    first, last = cubes.stamps[frames[[0, -1]]] if len(frames) else (0.0, 0.0)
    near = _chosen(clouds.stamps, first - MAX_OFFSET_S, last + MAX_OFFSET_S)
    near = near[:MAX_CLOUDS]
    if min(len(frames), len(near)) < 9:
        raise ValueError(
            f"{recording.name}: {len(frames)} radar frames and {len(near)} clouds "
            f"within {MAX_OFFSET_S:g} s of them, expected 9 or more of each"
        )
    radar = recording.radar.spec
    if radar.num_chirps >= 8:
        motion = np.array([radar_speed(cubes[int(i)], radar) for i in frames])
    else:
        motion = _changes(cubes, frames, _radar_change)
        frames = frames[1:]
    change = _changes(clouds, near, _lidar_change)
    stamps = clouds.stamps[near]
    return estimate_time_offset(
        cubes.stamps[frames],
        motion,
        0.5 * (stamps[1:] + stamps[:-1]),
        change / np.maximum(np.diff(stamps), 1e-6),
    )


def radar_speed(
    cube: Complex[np.ndarray, "tx rx chirp sample"], radar: RadarSpec
) -> float:
    """Return the mean absolute speed in m/s of a frame's echoes, weighted by power.

    One antenna pair is used. The median over Doppler bins is subtracted as noise; the
    speed of an empty frame is 0.
    """
    window = np.outer(np.hanning(radar.num_chirps), np.hanning(radar.num_samples))
    power = (np.abs(np.fft.fft2(cube[0, 0] * window)) ** 2).sum(-1)
    power = np.maximum(power - np.median(power), 0)
    speed = np.abs(np.fft.fftfreq(radar.num_chirps)) * 2 * radar.max_velocity_mps
    return float((power * speed).sum() / power.sum()) if power.any() else 0.0


def _chosen(stamps, first, last):
    """Return the indices of items from `first` to `last`, `PERIOD_S` apart."""
    inside = np.flatnonzero((stamps >= first) & (stamps <= last))
    if len(inside) < 2:
        return inside
    period = float(np.median(np.diff(stamps[inside])))
    return inside[:: max(round(PERIOD_S / max(period, 1e-9)), 1)]


def _changes(items, chosen, change):
    chosen_items = (items[int(index)] for index in chosen)
    return np.array([change(*two) for two in itertools.pairwise(chosen_items)])


def _radar_change(before, after):
    power = (np.abs(before) ** 2).sum() + (np.abs(after) ** 2).sum()
    return float((np.abs(after - before) ** 2).sum() / power) if power else 0.0


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


def _correlation(a, b):
    """Return Pearson's correlation; 0 if a signal is constant."""
    a, b = a - a.mean(), b - b.mean()
    scale = np.sqrt((a @ a) * (b @ b))
    return a @ b / scale if scale > 1e-12 else 0.0
