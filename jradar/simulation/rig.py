"""The rig that carries the sensors, and where each sensor sits on its base.

The base is the frame of the IMU. The radars look along its y axis, the direction of
walking: the platform of a scene (x forward) is the base rotated by -90 degrees. The
extrinsics are those of ColoRadar's calib folder (Kramer et al. 2022).

Both radars have the same quaternion there, without tilt: these are values of the
design, and the errors of the real mounts are unknown. The simulated radars are off by
about 1 degree and 1.5 cm, like mounts that were measured with a ruler.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jradar.lidar import rigid_transform
from jradar.simulation.scenes.trajectory import Trajectory, pose_at, velocity_at
from jradar.simulation.units import UnitSpec

EXTRINSICS = {  # base from sensor: x y z, then quaternion x y z w
    "single_chip": ((-0.145, 0.09, -0.025), (0, 0, 0.706825181105, 0.707388269167)),
    "cascade": ((0.03, 0.12, -0.09), (0, 0, 0.706825181105, 0.707388269167)),
    "lidar": ((-0.075, -0.02, 0.03618), (0, 0, 0.721382357437, -0.692536998563)),
    "imu": (
        (0.0, 0.0, 0.0),
        (0.707105451466, 0.707108048814, 0.000209535067884, 0.00020953429822),
    ),
    # A Livox is not on ColoRadar's rig: it looks forward, 25 degrees down.
    "livox": ((0.0, 0.05, 0.10), (-0.15304592, 0.15304592, 0.69034553, 0.69034553)),
}
PLATFORM_FROM_BASE = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
MISMOUNTED = ("single_chip", "cascade")
MOUNT_DEGREES, MOUNT_M = 1.0, 0.015  # rms of rotation and shift


class Viewpoint(NamedTuple):
    """Place, rotation and velocity of a radar in the world."""

    xyz: Float[np.ndarray, " 3"]
    turn: Float[np.ndarray, "3 3"]
    velocity: Float[np.ndarray, " 3"]


def base_from(sensor: str) -> Float[np.ndarray, "4 4"]:
    """Return the true transform from a sensor's frame to the base."""
    return rigid_transform(*map(np.array, EXTRINSICS[sensor])) @ mount_error(sensor)


def mount_error(sensor: str) -> Float[np.ndarray, "4 4"]:
    """Return the transform from the true place of a sensor to the one in `calib`."""
    error = np.eye(4)
    if sensor in MISMOUNTED:
        random = np.random.default_rng([3, *sensor.encode()])
        turn, shift = random.standard_normal((2, 3)) / 3**0.5
        turn = Rotation.from_rotvec(np.radians(MOUNT_DEGREES) * turn)
        error[:3, :3], error[:3, 3] = turn.as_matrix(), MOUNT_M * shift
    return error


def described_mount(sensor: str, unit: UnitSpec) -> tuple[list[float], list[float]]:
    """Return the place of a unit's sensor as its user measured it, with the errors."""
    random = np.random.default_rng([unit.board or 0, *b"mount"])
    turn, shift = random.standard_normal((2, 3)) / 3**0.5
    error = Rotation.from_rotvec(np.radians(unit.mount_degrees) * turn)
    true = base_from(sensor)
    measured = (Rotation.from_matrix(true[:3, :3]) * error).as_quat()
    return (true[:3, 3] + MOUNT_M * shift).tolist(), measured.tolist()


def sensor_pose(
    platform: Trajectory, sensor: str, time_s: Float[np.ndarray, "*batch"] | float
) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 3 3"]]:
    """Return position and rotation of a sensor, or of "base", in the world."""
    xyz, turn = pose_at(platform, time_s)
    turn = turn @ PLATFORM_FROM_BASE
    if sensor == "base":
        return xyz, turn
    mount = base_from(sensor)
    return xyz + turn @ mount[:3, 3], turn @ mount[:3, :3]


def viewpoint(platform: Trajectory, sensor: str, time_s: float) -> Viewpoint:
    """Return a radar's place and velocity at one time, lever arm included."""
    xyz, turn = sensor_pose(platform, sensor, float(time_s))
    velocity, spin = velocity_at(platform, float(time_s))
    base, _ = pose_at(platform, float(time_s))
    return Viewpoint(xyz, turn, velocity + np.cross(spin, xyz - base))
