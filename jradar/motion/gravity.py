"""Mounts that gravity contradicts: which sensor of a rig is upside down.

The mean force that a carried IMU measures is gravity's reaction, which points up. The
descriptions of the mounts rotate it into the axes of the radar, whose z axis should
point up, too.

         up, measured          radar upside down:      `upside_down = true` describes
            |                  its z axis points       its antennas, so that z is up
    base ---+--- IMU           down by rpy_degrees     again
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from jradar.recordings import Imu, Recording

DOWN_DEG, ASIDE_DEG = 120.0, 60.0  # of an axis from the vertical
STANDARD_GRAVITY = 9.80665
LARGEST_SHARE = 0.3  # by which a mean force may differ from gravity
FEW = 10  # records
FLIP = (
    "unless its TOML description says so, write `upside_down = true` in the table "
    "[radar], and keep its z axis up in rpy_degrees"
)


def gravity_warnings(recording: Recording) -> tuple[str, ...]:
    """Return what gravity contradicts in the mounts, in words; () without an IMU.

    Without the places of IMU and radar on a base, their axes are taken as one.
    """
    return tuple(_warnings(recording)) if recording.imu is not None else ()


def _warnings(recording: Recording) -> Iterator[str]:
    imu, mount = recording.imu, recording.base_from_radar
    assert imu is not None
    force = _mean_force(imu, recording)
    strength = float(np.linalg.norm(force))
    if abs(strength / STANDARD_GRAVITY - 1) > LARGEST_SHARE:
        yield (
            f"the IMU's mean force is {strength:.3g} m/s^2, expected about "
            f"{STANDARD_GRAVITY:.2f} of gravity: it shows no vertical"
        )
        return
    if recording.base_from_imu is None or mount is None:
        if (off := _from_vertical(force)) > DOWN_DEG:
            yield (
                f"by gravity, the IMU is upside down: its z axis is {off:.0f} degrees "
                f"from up. If the radar is mounted like it: {FLIP}"
            )
        return
    up = recording.base_from_imu[:3, :3] @ force
    off = _from_vertical(mount[:3, :3].T @ up)
    if (base := _from_vertical(up)) > ASIDE_DEG:
        yield (
            f"by gravity, the z axis of the base is {base:.0f} degrees from up: the "
            "rig was upside down or on its side, or rpy_degrees of the IMU is wrong"
        )
    elif off > DOWN_DEG:
        yield (
            f"by gravity, the radar is mounted upside down: its described z axis is "
            f"{off:.0f} degrees from up, and so are its points for a model: {FLIP}"
        )
    elif off > ASIDE_DEG:
        yield (
            f"by gravity, the radar lies on its side: its described z axis is "
            f"{off:.0f} degrees from up. Models expect it within {ASIDE_DEG:.0f}: "
            "mount it upright, or correct its rpy_degrees"
        )


def _mean_force(imu: Imu, recording: Recording) -> Float[np.ndarray, " 3"]:
    """The mean while the radar recorded, if the clocks agree, or else of all."""
    stamps = recording.cubes.stamps
    if stamps is not None and len(stamps):
        within = (imu.stamps >= stamps[0]) & (imu.stamps <= stamps[-1])
        if within.sum() >= FEW:
            return imu.force[within].mean(0)
    return imu.force.mean(0)


def _from_vertical(up: Float[np.ndarray, " 3"]) -> float:
    """The angle in degrees of the z axis from a vector that points up."""
    return float(np.degrees(np.arccos(np.clip(up[2] / np.linalg.norm(up), -1, 1))))
