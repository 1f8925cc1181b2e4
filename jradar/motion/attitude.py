"""Orientation over time, from the gyroscope of an IMU or from poses; host NumPy.

Orientations are rotations from the base to the world. The gyroscope's bias is its mean
while the rig stands still, according to the radar. The vertical is the mean of all
accelerations, less the change of the radar's velocity.
"""

import numpy as np
import scipy  # loads `spatial` when it is first used
from jaxtyping import Bool, Float

from jradar.errors import UsageError
from jradar.lidar import Poses, interpolate_poses
from jradar.recordings import Imu

STILL_MPS = 0.1  # speed of a rig that stands still, by its radar
STILL_RATE = 0.05  # rad/s, deviation of the rates of a rig that stands still
LEAST_STILL_S = 0.5
MARGIN_S = 0.1  # at either end of standing still
OUTSIDE_S = 0.1  # by which frames may lie outside the IMU's records
FEW = 10  # records

Matrices = Float[np.ndarray, "stamp 3 3"]


def gyro_attitude(
    imu: Imu,
    stamps: Float[np.ndarray, " stamp"],
    base_from_imu: Float[np.ndarray, "4 4"],
    *,
    bias: Float[np.ndarray, " 3"] | float = 0.0,
) -> Matrices:
    """Return world_from_base at rising `stamps`, the world being the first base.

    `bias` in rad/s, along the IMU's axes, is subtracted from its rates. Raises
    ValueError if the IMU does not cover the stamps.
    """
    times = imu.stamps
    before, after = stamps[0] + OUTSIDE_S, stamps[-1] - OUTSIDE_S
    if len(times) < 2 or before < times[0] or after > times[-1]:
        raise ValueError(
            f"the IMU's {len(times)} records do not cover the frames from "
            f"{stamps[0]:.3f} to {stamps[-1]:.3f} s: are its times on another clock?"
        )
    mount = base_from_imu[:3, :3]
    rate = (imu.rate - bias) @ mount.T
    steps = (rate[1:] + rate[:-1]) / 2 * np.diff(times)[:, None]
    turned = np.empty((len(times), 3, 3))
    turned[0] = np.eye(3)
    for k, step in enumerate(
        scipy.spatial.transform.Rotation.from_rotvec(steps).as_matrix()
    ):
        turned[k + 1] = turned[k] @ step
    origin = times[0]
    course = scipy.spatial.transform.Slerp(
        times - origin, scipy.spatial.transform.Rotation.from_matrix(turned)
    )
    at = course(np.clip(stamps, times[0], times[-1]) - origin)
    return (at[0].inv() * at).as_matrix()


def gyro_bias(
    imu: Imu,
    stamps: Float[np.ndarray, " frame"],
    speed_mps: Float[np.ndarray, " frame"],
) -> Float[np.ndarray, " 3"] | None:
    """Return the gyroscope's mean rate while the rig stands still, None if never.

    It stands still where the radar's speeds stay below 0.1 m/s for half a second and
    the rates hardly change.
    """
    still = np.r_[False, speed_mps < STILL_MPS, False]
    edges = np.flatnonzero(np.diff(still.astype(int)))
    found = []
    for first, end in edges.reshape(-1, 2):
        begin, last = stamps[first] + MARGIN_S, stamps[end - 1] - MARGIN_S
        within = (imu.stamps >= begin) & (imu.stamps <= last)
        if last - begin >= LEAST_STILL_S - 2 * MARGIN_S and within.sum() >= FEW:
            rates = imu.rate[within]
            if rates.std(0).max() < STILL_RATE:
                found.append(rates)
    return np.concatenate(found).mean(0) if found else None


def levelled(
    imu: Imu,
    stamps: Float[np.ndarray, " stamp"],
    turns: Matrices,
    base_from_imu: Float[np.ndarray, "4 4"],
    velocity: Float[np.ndarray, "stamp 3"],
) -> Matrices:
    """Return `turns` in a world whose z axis points up.

    `velocity` is the IMU's in the world of `turns`, m/s. Between the first and the last
    stamp, the mean specific force is gravity's reaction plus the change of velocity
    over time.
    """
    within = (imu.stamps >= stamps[0]) & (imu.stamps <= stamps[-1])
    if within.sum() < FEW:
        return turns
    course = scipy.spatial.transform.Slerp(
        stamps - stamps[0], scipy.spatial.transform.Rotation.from_matrix(turns)
    )
    force = imu.force[within] @ base_from_imu[:3, :3].T
    mean = course(imu.stamps[within] - stamps[0]).apply(force).mean(0)
    up = mean - (velocity[-1] - velocity[0]) / (stamps[-1] - stamps[0])
    align = scipy.spatial.transform.Rotation.align_vectors
    level, _ = align([[0.0, 0.0, 1.0]], up[None])
    return level.as_matrix() @ turns


def pose_attitude(poses: Poses, stamps: Float[np.ndarray, " stamp"]) -> Matrices:
    """Return world_from_base at `stamps`; ValueError if the poses do not cover them."""
    turns = interpolate_poses(poses, stamps)[:, :3, :3]
    if not np.isfinite(turns).all():
        first, last = poses.stamps[[0, -1]]
        raise ValueError(
            f"the poses from {first:.3f} to {last:.3f} s do not cover the frames from "
            f"{stamps[0]:.3f} to {stamps[-1]:.3f} s: choose frames within"
        )
    return turns


def within_poses(
    poses: Poses, stamps: Float[np.ndarray, " stamp"]
) -> tuple[Bool[np.ndarray, " stamp"], list[str]]:
    """Return which frames lie within the poses, and a note on those that are left out.

    Raises UsageError if none do.
    """
    first, last = poses.stamps[[0, -1]]
    inside = (stamps >= first) & (stamps <= last)
    out, span = (
        len(stamps) - inside.sum(),
        f"the poses from {first:.3f} to {last:.3f} s",
    )
    if not inside.any():
        raise UsageError(
            f"none of {out} frames, from {stamps[0]:.3f} to {stamps[-1]:.3f} s, is "
            f"within {span}: are their times on another clock?"
        )
    note = f"{out} of {len(stamps)} frames are outside {span}, and are left out"
    return inside, [note] if out else []
