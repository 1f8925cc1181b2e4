"""What files hold, as plain numbers and texts that JSON can carry."""

import re
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from jradar.radar import RadarSpec
from jradar.recordings.recording import Recording, radar_from_lidar

BAGS = (".bag", ".mcap", ".db3")
CLOUDS = (".ply", ".pcd")
CLOUD_NAMES = re.compile(r"(.*lidar.*|[0-9]+)\.bin")  # ColoRadar's and KITTI's
GAP = 1.5  # steps between stamps longer than so many median ones


def describe(recording: Recording) -> dict[str, Any]:
    """Radar, rates and faults of each stream, calibration, transforms, notes.

    The first and the last item of each stream are read; what cannot be is said under
    "readable" and raises nothing.
    """
    poses = recording.poses
    streams = [_timing("radar", len(recording.cubes), recording.cubes.stamps)]
    if recording.lidar is not None:
        streams.append(_timing("lidar", len(recording.lidar), recording.lidar.stamps))
    if poses is not None:
        streams.append(_timing("poses", len(poses.stamps), poses.stamps))
    return {
        "capture": str(recording.path),
        "frames": len(recording.cubes),
        "radar": _radar(recording.radar),
        "streams": streams,
        **_company(recording),
        "readable": _readable(recording),
        "calibration": _calibration(recording),
        "transforms": _transforms(recording),
        **_lost(recording),
        "notes": [*recording.notes],
    }


def describe_file(path: Path | str) -> dict[str, Any] | None:
    """Topics of a bag; points and bounds of a cloud; None for any other path."""
    path = Path(path)
    if path.suffix in BAGS or (path / "metadata.yaml").is_file():
        from jradar.recordings.bags import bag_topics

        topics = [
            {"topic": name, "type": kind, "messages": count}
            for name, (kind, count) in bag_topics(path).items()
        ]
        return {"bag": str(path), "topics": topics}
    if path.suffix not in CLOUDS and not CLOUD_NAMES.fullmatch(path.name):
        return None
    from jradar.recordings.clouds import read_cloud

    columns = read_cloud(path)
    xyz = np.stack([columns[axis] for axis in "xyz"], -1)
    returns = xyz[np.isfinite(xyz).all(1) & (xyz != 0).any(1)]
    bounds = [returns.min(0).tolist(), returns.max(0).tolist()] if len(returns) else []
    return {
        "cloud": str(path),
        "points": len(xyz),
        "finite and not (0, 0, 0)": len(returns),
        "fields": " ".join(columns),
        **dict(zip(("lowest_m", "highest_m"), bounds, strict=False)),
    }


def _radar(radar: RadarSpec) -> dict[str, Any]:
    """The radar and what follows from it."""
    return {
        "name": radar.name,
        "tx x rx x chirps x samples": list(radar.cube_shape),
        "fires tx in the order": " ".join(map(str, radar.tx_firing_order)),
        "measures elevation": radar.has_elevation,
        "range_resolution_m": radar.range_resolution_m,
        "max_range_m": radar.max_range_m,
        "velocity_resolution_mps": radar.velocity_resolution_mps,
        "max_velocity_mps": radar.max_velocity_mps,
        "wavelength_m": radar.wavelength_m,
    }


def _timing(name: str, count: int, stamps: np.ndarray | None) -> dict[str, Any]:
    """Rate of a stream, and where its stamps are not what a steady sensor gives."""
    known = stamps is not None and len(stamps) > 1
    steps = np.diff(stamps) if stamps is not None and known else np.zeros(0)
    forward = steps[steps > 0]
    usual = float(np.median(forward)) if forward.size else None
    return {
        "stream": name,
        "items": count,
        "rate_hz": 1 / usual if usual else None,
        "seconds": float(np.ptp(stamps)) if stamps is not None and known else None,
        "gaps": int((forward > GAP * usual).sum()) if usual else None,
        "longest_gap_s": float(forward.max()) if usual else None,
        "repeated": int((steps == 0).sum()) if known else None,
        "backwards": int((steps < 0).sum()) if known else None,
    }


def _company(recording: Recording) -> dict[str, Any]:
    """How many frames have a LiDAR scan within 50 ms, and a pose before and after."""
    stamps, found = recording.cubes.stamps, {}
    if stamps is None:
        return found
    if recording.lidar is not None and recording.lidar.stamps is not None:
        scans = np.concatenate([[-np.inf], np.sort(recording.lidar.stamps), [np.inf]])
        after = np.searchsorted(scans, stamps)
        apart = np.minimum(stamps - scans[after - 1], scans[after] - stamps)
        found["frames with a LiDAR scan"] = int((apart <= 0.05).sum())
    if recording.poses is not None:
        first, last = recording.poses.stamps[[0, -1]]
        inside = (stamps >= first) & (stamps <= last)
        found["frames with a pose"] = int(inside.sum())
    return found


def _readable(recording: Recording) -> dict[str, str]:
    """The first and the last item of each stream, or the error that they raise."""
    said = {}
    for name, stream in (("frame", recording.cubes), ("scan", recording.lidar)):
        count = len(stream) if stream is not None else 0
        for item in sorted({0, count - 1}) if count else ():
            said[f"{name} {item}"] = _one(stream, item)
    return said


def _one(stream, item: int) -> str:
    """What an item is, in words."""
    try:
        array = stream[item]
    except (ValueError, OSError) as error:
        return f"cannot be read: {error}"
    if np.iscomplexobj(array):
        peak = max(abs(array.real).max(), abs(array.imag).max())
        return f"yes, counts up to {peak:,.0f}"
    returns = np.isfinite(array).all(1) & (array[:, :3] != 0).any(1)
    return f"yes, {len(array):,} points, {returns.sum():,} of them returns"


def _calibration(recording: Recording) -> list[str]:
    """Corrections that the recording brings along."""
    found = []
    if recording.coupling is not None:
        shape = " x ".join(map(str, recording.coupling.shape))
        found.append(f"coupling, {shape} [tx, rx, range bin]")
    if recording.frequency_phase is not None:
        shape = " x ".join(map(str, recording.frequency_phase.phase.shape))
        found.append(f"frequency and phase, {shape} [tx, rx]")
    if recording.channel_factors is not None:
        found.append(f"factors of {len(recording.channel_factors)} virtual antennas")
    if recording.range_bias_m:
        found.append(f"range bias {recording.range_bias_m:g} m")
    return found or ["none"]


def _transforms(recording: Recording) -> dict[str, Any]:
    """Where the sensors are: metres and degrees."""
    found = {
        "radar in the base": recording.base_from_radar,
        "lidar in the base": recording.base_from_lidar,
        "lidar in the radar's frame": radar_from_lidar(recording),
    }
    return {
        name: {
            "xyz_m": matrix[:3, 3].tolist(),
            "yaw_pitch_roll_deg": Rotation.from_matrix(matrix[:3, :3])
            .as_euler("ZYX", degrees=True)
            .tolist(),
        }
        for name, matrix in found.items()
        if matrix is not None
    }


def _lost(recording: Recording) -> dict[str, Any]:
    """Bytes that the network lost, where the reader counted them."""
    if recording.lost_bytes is None:
        return {}
    return {
        "lost bytes": int(recording.lost_bytes.sum()),
        "frames with losses": int((recording.lost_bytes > 0).sum()),
    }
