"""A room as the points of a radar and the scans of a LiDAR, packed as Astyx is."""

from pathlib import Path

import numpy as np

from tests.recordings.small_sequence import PILLAR, SIDE, room_scan

START_US = 1_700_000_000_000_000
AWAY = [[40.0, 3.0, 0.5]] * 25  # beyond the LiDAR and every view
SIZES = {"wall": 60, "pillar": 12}


def write_astyx(path: Path, frames: list[tuple[str, ...]], *, seed: int = 0) -> Path:
    """Write frames that hold points of "wall", "pillar", or of both, 0.1 s apart.

    Points lie within 5 cm of what they are on. Each frame with any also has those of
    AWAY. Both sensors are at rest in the middle of the room.
    """
    rng = np.random.default_rng(seed)
    clouds = [_points(rng, frame) for frame in frames]
    scans = [room_scan(rng)[:, :3] for _ in frames]
    scans = [scan[scan.any(-1)] for scan in scans]
    points = np.concatenate(clouds)
    times = START_US + 100_000 * np.arange(len(frames))
    np.savez(
        path,
        radar_cm=np.rint(100 * points).astype("<i2"),
        radar_mm_s=rng.integers(-900, 900, len(points)).astype("<i2"),
        radar_half_db=rng.integers(90, 140, len(points)).astype("<i2"),
        radar_count=np.array([*map(len, clouds)]),
        lidar_cm=np.rint(100 * np.concatenate(scans)).astype("<i2"),
        lidar_count=np.array([*map(len, scans)]),
        lidar_time_us=times,
        frame=np.arange(len(frames)),
    )
    return path


def _points(rng, frame):
    parts = [np.zeros((0, 3)), *([AWAY] if frame else [])]
    if "wall" in frame:
        aside = rng.uniform((-3, -0.8), (3, 0.8), (SIZES["wall"], 2))
        parts.append(np.insert(aside, 0, SIDE, axis=1))
    if "pillar" in frame:
        height = rng.uniform(-0.6, 0.6, SIZES["pillar"])
        parts.append(np.column_stack([*np.tile(PILLAR, (len(height), 1)).T, height]))
    points = np.concatenate(parts)
    return points + rng.uniform(-0.05, 0.05, points.shape)
