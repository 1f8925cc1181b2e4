"""From velocities and orientation to a trajectory; host NumPy.

position of the radar  =  integral of world_from_base base_from_radar v_radar dt
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jradar.errors import UsageError
from jradar.files import atomic_path
from jradar.motion.attitude import (
    gyro_attitude,
    gyro_bias,
    levelled,
    pose_attitude,
    within_poses,
)
from jradar.motion.scans import scan_poses, to_poses
from jradar.motion.velocities import Velocities, outliers
from jradar.options.recordings import ROTATIONS
from jradar.recordings import Recording

STEEP = 0.1  # height over distance; walks are rarely steeper
COMMENT = "# jradar trajectory: stamp x y z qx qy qz qw"


class Trajectory(NamedTuple):
    """Poses of a radar in the world, in the middle of each frame."""

    stamps: Float[np.ndarray, " frame"]  # seconds
    world_from_radar: Float[np.ndarray, "frame 4 4"]
    base_from_radar: Float[np.ndarray, "4 4"]
    notes: tuple[str, ...] = ()

    @property
    def world_from_base(self) -> Float[np.ndarray, "frame 4 4"]:
        """Poses of the base of the rig."""
        return self.world_from_radar @ np.linalg.inv(self.base_from_radar)

    @property
    def distance_m(self) -> float:
        """Length of the base's path."""
        steps = np.diff(self.world_from_base[:, :3, 3], axis=0)
        return float(np.linalg.norm(steps, axis=1).sum())


def odometry(
    recording: Recording, velocities: Velocities, *, rotation: str = "imu"
) -> Trajectory:
    """Return the trajectory of a recording's radar from its velocities.

    `rotation` is "imu" (its gyroscope), "poses" (the recorded ones), "lidar" (scan
    matching) or "none" (the rig does not rotate). The base is first at the origin.
    Velocities unlike their neighbours' are bridged, and frames outside the poses that
    it uses are left out. Raises UsageError for what the recording lacks.
    """
    if rotation not in ROTATIONS:
        raise UsageError(f"{rotation=}, expected one of {', '.join(ROTATIONS)}")
    turns, outside = np.stack([np.eye(3)] * len(velocities.stamps)), []
    if rotation == "poses":
        if recording.poses is None:
            raise UsageError(f"{recording.path} has no poses: use another rotation")
        inside, outside = within_poses(recording.poses, velocities.stamps)
        velocities = Velocities(*(column[inside] for column in velocities))
        turns = pose_attitude(recording.poses, velocities.stamps)
    stamps, notes = velocities.stamps, [*outside, *_notes(recording, velocities)]
    wrong = outliers(velocities)
    if wrong.any():
        count = int(wrong.sum())
        which, them = ("1 frame", "it") if count == 1 else (f"{count} frames", "them")
        notes.append(
            f"the velocity of {which} is far from that of the frames around {them}, "
            "and is bridged"
        )
        kept = np.where(wrong[:, None], np.nan, velocities.velocity)
        velocities = velocities._replace(velocity=kept)
    mount = recording.base_from_radar
    if mount is None:
        mount = np.eye(4)
        notes.append("the radar's place on the base is unknown: they are taken as one")
    if rotation == "imu":
        turns = _from_imu(recording, velocities, mount, notes)
    elif rotation == "lidar":
        poses = scan_poses(recording)
        # The LiDAR's first and last scan may lie within the radar's frames.
        turns = pose_attitude(poses, np.clip(stamps, *poses.stamps[[0, -1]]))
    found = integrate(velocities, turns, mount)
    notes += _climb(recording, found)
    return found._replace(notes=tuple(notes))


def _notes(recording: Recording, velocities: Velocities) -> Iterator[str]:
    missing = np.flatnonzero(~np.isfinite(velocities.velocity[:, 0]))
    if len(missing):
        yield (
            f"no velocity in {len(missing)} of {len(velocities.stamps)} frames, which "
            "are bridged"
        )
    if not recording.has_elevation:
        yield "the array has one row: the radar is taken to move in its own plane"


def _climb(recording: Recording, found: Trajectory) -> Iterator[str]:
    """Yield a note on the height gained by an array that may seem tilted."""
    first, last = found.world_from_base[[0, -1], 2, 3]
    verb, height_m = "climbs" if last > first else "sinks", abs(last - first)
    if recording.of_points:
        unknown = recording.imu is not None and recording.base_from_radar is None
        if unknown and height_m > STEEP * found.distance_m:
            yield (
                f"the path {verb} by {height_m:.1f} m on {found.distance_m:.1f} m: is "
                "the radar rotated against the IMU? Name rpy_degrees of both in a "
                "capture.toml"
            )
    elif recording.has_elevation and not recording.radar.calibrated:
        yield (
            f"the path {verb} by {height_m:.1f} m, and the radar is not calibrated: "
            "its array may only seem tilted, see jradar calibrate --level"
        )


def _from_imu(recording, velocities, mount, notes):
    imu, place = recording.imu, recording.base_from_imu
    if imu is None:
        raise UsageError(f"{recording.path} has no IMU: use another rotation")
    if place is None:
        place = np.eye(4)
        notes.append("the IMU's place on the base is unknown: they are taken as one")
    stamps = velocities.stamps
    speed = np.linalg.norm(velocities.velocity, axis=1)
    bias = gyro_bias(imu, stamps, speed)
    if bias is None:
        bias = np.zeros(3)
        notes.append(
            "the rig never stands still: the gyroscope's bias is unknown, taken as 0"
        )
    turns = gyro_attitude(imu, stamps, place, bias=bias)
    rates = [np.interp(stamps, imu.stamps, axis) for axis in imu.rate.T]
    rate = (np.stack(rates, -1) - bias) @ place[:3, :3].T
    # The radar's velocity less that of turning about the IMU.
    arm = np.einsum("tij,tj->ti", turns, np.cross(rate, mount[:3, 3] - place[:3, 3]))
    world = _in_world(velocities, turns, mount) - arm
    return levelled(imu, stamps, turns, place, world)


def integrate(
    velocities: Velocities,
    turns: Float[np.ndarray, "frame 3 3"],
    base_from_radar: Float[np.ndarray, "4 4"],
) -> Trajectory:
    """Return the trajectory with the orientations `turns` of the base in the world.

    Velocities change linearly from frame to frame, and across frames without one. The
    base begins at the origin. Raises ValueError if no frame has a velocity.
    """
    world = _in_world(velocities, turns, base_from_radar)
    steps = np.diff(velocities.stamps)[:, None] * (world[1:] + world[:-1]) / 2
    poses = np.tile(np.eye(4), (len(turns), 1, 1))
    poses[:, :3, :3] = turns @ base_from_radar[:3, :3]
    start = turns[0] @ base_from_radar[:3, 3]
    poses[:, :3, 3] = start + np.concatenate([np.zeros((1, 3)), steps.cumsum(0)])
    return Trajectory(velocities.stamps, poses, base_from_radar)


def _in_world(velocities, turns, base_from_radar):
    """The radar's velocities in the world, without gaps."""
    stamps = velocities.stamps
    known = np.isfinite(velocities.velocity).all(1)
    if not known.any() or not (np.diff(stamps) > 0).all():
        raise ValueError(
            f"{known.sum()} velocities at {len(stamps)} times, expected one or more at "
            "rising times"
        )
    ours = turns @ base_from_radar[:3, :3]
    world = np.einsum("tij,tj->ti", ours[known], velocities.velocity[known])
    return np.stack([np.interp(stamps, stamps[known], axis) for axis in world.T], -1)


def relative_poses(
    trajectory: Trajectory,
    source: Int[np.ndarray, "*pair"] | int,
    target: Int[np.ndarray, "*pair"] | int,
) -> Float[np.ndarray, "*pair 4 4"]:
    """Return target_from_source: points of frame `source` to the frame `target`.

    Both are places in the trajectory, single or in arrays; the frames are the radar's
    own, x forward, y left, z up, in the middle of its frame in time.
    """
    poses = trajectory.world_from_radar
    return np.linalg.solve(poses[target], poses[source])


def write_tum(path: Path | str, trajectory: Trajectory) -> None:
    """Write the poses of the base as lines `stamp x y z qx qy qz qw`."""
    poses = to_poses(trajectory.stamps, trajectory.world_from_base)
    lines = [f"{COMMENT}\n"]
    for stamp, xyz, turn in zip(*poses, strict=True):
        numbers = " ".join(f"{value:.9f}" for value in (*xyz, *turn))
        lines.append(f"{stamp:.6f} {numbers}\n")
    with atomic_path(path) as scratch:
        scratch.write_text("".join(lines), encoding="utf-8")
