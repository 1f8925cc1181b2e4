"""The contents of recordings, bags and clouds as plain values that JSON can carry."""

import re
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from jradar.options.sensor import RadarSpec
from jradar.recordings.bags.bags import (
    bag_notes,
    bag_times,
    bag_topics,
    is_bag,
    open_bag,
)
from jradar.recordings.bags.mcap_files import describe_mcap, is_other_mcap
from jradar.recordings.bags.messages import is_cloud_type
from jradar.recordings.clouds.read import read_cloud
from jradar.recordings.points.frames import describe_points
from jradar.recordings.recording import (
    Format,
    Recording,
    clocks_apart,
    radar_from_lidar,
)

CLOUD_NAMES = re.compile(r".*\.(ply|pcd)|(.*lidar.*|[0-9]+)\.bin", re.IGNORECASE)
TIMING = ("seconds", "rate_hz", "gaps", "longest_gap_s")  # of a bag's topic
GAP = 1.5  # median steps: a longer step between stamps counts as a gap


def describe(recording: Recording) -> dict[str, Any]:
    """Return radar, rates and faults of each stream, calibration, transforms, notes.

    The first and the last item of each stream are read; an item that cannot be read is
    reported under "readable".
    """
    poses, lost = recording.poses, {}
    cubes, points, frames = recording.cubes, recording.points, recording.frames
    streams = [_timing("radar", len(frames), frames.stamps)]
    if recording.lidar is not None:
        streams.append(_timing("lidar", len(recording.lidar), recording.lidar.stamps))
    if poses is not None:
        streams.append(_timing("poses", len(poses.stamps), poses.stamps))
    if (imu := recording.imu) is not None:
        streams.append(_timing("imu", len(imu.stamps), imu.stamps))
    if (bytes_of_frame := recording.lost_bytes) is not None:
        lost["lost bytes"] = int(bytes_of_frame.sum())
        lost["frames with losses"] = int((bytes_of_frame > 0).sum())
    return {
        "recording": str(recording.path),
        "frames": len(frames),
        **(
            {"radar": describe_radar(recording.radar.spec)}
            if recording.radar is not None
            else {}
        ),
        **({} if points is None else {"points": describe_points(points)}),
        **({"fields": dict(recording.fields)} if recording.fields else {}),
        "streams": streams,
        **_matches(recording),
        "readable": {
            f"{name} {item}": _item(stream, item)
            for name, stream in (("frame", cubes), ("scan", recording.lidar))
            for item in (sorted({0, len(stream) - 1}) if stream else ())
        },
        **(
            {"calibration": _calibration(recording)}
            if recording.radar is not None
            else {}
        ),
        "transforms": _transforms(recording),
        **lost,
        **({} if points is None else _topics(recording.path)),
        "notes": [*recording.notes],
    }


def _topics(path: Path) -> dict[str, Any]:
    """Return the topics of a bag, of which a capture.toml may name others."""
    return {"topics": describe_bag(path)["topics"]} if is_bag(path) else {}


def describe_bag(path: Path | str) -> dict[str, Any]:
    """Return type, messages, first and last time, rate and gaps of a bag's topics.

    Times are in seconds. Those of clouds come from their headers, on the clock that a
    capture.toml counts on; those of other messages are times of recording.
    """
    rows, notes, times = [], [*bag_notes(path)], bag_times(path)
    for topic, (kind, count) in bag_topics(path).items():
        stamps = times.get(topic, np.zeros(0))
        if count and is_cloud_type(kind):
            clouds = open_bag(path, topic=topic)
            stamps = stamps if clouds.stamps is None else clouds.stamps
            notes += [note for note in clouds.notes if note not in notes]
        timing = _timing(topic, count, stamps)
        first, last = stamps[[0, -1]].tolist() if len(stamps) else (None, None)
        rows.append(
            {"topic": topic, "type": kind, "messages": count}
            | {"first_s": first, "last_s": last}
            | {name: timing[name] for name in TIMING}
        )
    return {"bag": str(path), "topics": rows, "notes": notes}


def describe_cloud(path: Path | str) -> dict[str, Any]:
    """Return the number of points, the fields and the bounds of a cloud."""
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


CONTENTS = (
    Format("an MCAP file for Foxglove", is_other_mcap, describe_mcap),
    Format(
        "a bag: .bag, .mcap, .db3 or a ROS 2 folder",
        is_bag,
        describe_bag,
    ),
    Format(
        "a cloud: .ply, .pcd, or a .bin of float32 as of KITTI, nuScenes or ColoRadar",
        lambda path: CLOUD_NAMES.fullmatch(path.name) is not None,
        describe_cloud,
    ),
)


def describe_file(path: Path | str) -> dict[str, Any] | None:
    """Return what a file without radar frames holds; None if it is not in CONTENTS."""
    path = Path(path)
    return next((kind.open(path) for kind in CONTENTS if kind.matches(path)), None)


def describe_radar(radar: RadarSpec) -> dict[str, Any]:
    """Return what a radar measures: directions, resolutions and largest values."""
    return {
        "name": radar.name,
        "tx x rx x chirps x samples": list(radar.cube_shape),
        "tx firing order": " ".join(map(str, radar.tx_firing_order)),
        "measures azimuth": radar.has_azimuth,
        "measures elevation": radar.has_elevation,
        "range_resolution_m": radar.range_resolution_m,
        "max_range_m": radar.max_range_m,
        "velocity_resolution_mps": radar.velocity_resolution_mps,
        "max_velocity_mps": radar.max_velocity_mps,
        "wavelength_m": radar.wavelength_m,
    }


def _timing(name: str, count: int, stamps: np.ndarray | None) -> dict[str, Any]:
    times = np.zeros(0) if stamps is None else stamps
    known, steps = len(times) > 1, np.diff(times)
    forward = steps[steps > 0]
    usual = float(np.median(forward)) if forward.size else None
    return {
        "stream": name,
        "items": count,
        "rate_hz": 1 / usual if usual else None,
        "seconds": float(np.ptp(times)) if known else None,
        "gaps": int((forward > GAP * usual).sum()) if usual else None,
        "longest_gap_s": float(forward.max()) if usual else None,
        "repeated": int((steps == 0).sum()) if known else None,
        "backwards": int((steps < 0).sum()) if known else None,
    }


def _matches(recording: Recording) -> dict[str, Any]:
    """Count the frames with a LiDAR scan within 50 ms, and with a pose around them.

    Streams whose times do not overlap are reported with both spans instead.
    """
    stamps, lidar, found = recording.frames.stamps, recording.lidar, {}
    if stamps is None:
        return found
    if lidar is not None and lidar.stamps is not None:
        scans = np.concatenate([[-np.inf], np.sort(lidar.stamps), [np.inf]])
        after = np.searchsorted(scans, stamps)
        apart = np.minimum(stamps - scans[after - 1], scans[after] - stamps)
        found["frames with a LiDAR scan"] = int((apart <= 0.05).sum())
        if spans := clocks_apart(stamps, lidar.stamps):
            found["frames with a LiDAR scan"] = f"the clocks do not match: {spans}"
    if recording.poses is not None:
        first, last = recording.poses.stamps[[0, -1]]
        inside = (stamps >= first) & (stamps <= last)
        found["frames with a pose"] = int(inside.sum())
        if spans := clocks_apart(stamps, recording.poses.stamps):
            found["frames with a pose"] = f"the clocks do not match: {spans}"
    return found


def _item(stream, item: int) -> str:
    """Return the size of an item in words, or the error that reading it raises."""
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
    radar, found = recording.radar, []
    if radar.leakage is not None:
        shape = " x ".join(map(str, radar.leakage.shape))
        found.append(f"leakage, {shape} [tx, rx, range bin]")
    if radar.beat_bins is not None:
        shape = " x ".join(map(str, radar.beat_bins.shape))
        found.append(f"beat frequencies, {shape} [tx, rx]")
    if radar.channels is not None:
        found.append(f"factors of {radar.channels.size} virtual antennas")
    if radar.range_bias_m:
        found.append(f"range bias {radar.range_bias_m:g} m")
    return found or ["none"]


def _transforms(recording: Recording) -> dict[str, Any]:
    found = {
        "radar in the base": recording.base_from_radar,
        "lidar in the base": recording.base_from_lidar,
        "lidar in the radar's frame": radar_from_lidar(recording),
    }
    places = {}
    for name, matrix in found.items():
        if matrix is not None:
            angles = yaw_pitch_roll(matrix)
            position = matrix[:3, 3].tolist()
            places[name] = {"xyz_m": position, "yaw_pitch_roll_deg": angles}
    return places


def yaw_pitch_roll(matrix: Float[np.ndarray, "4 4"]) -> list[float]:
    """Return the degrees about z, then the new y, then the new x of a transform.

    The same as SciPy's `Rotation`, which loads for longer than `jradar info` runs.
    """
    (ahead, *_), (left, *_), (up, left_up, up_up) = matrix[:3, :3]
    yaw, roll = np.arctan2(left, ahead), np.arctan2(left_up, up_up)
    pitch = np.arctan2(-up, np.hypot(ahead, left))
    return (np.degrees([yaw, pitch, roll]) + 0.0).tolist()  # without -0
