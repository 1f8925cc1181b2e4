"""The rig that carries the sensors, as ColoRadar built it: where each sits on the base.

The base is the frame of the IMU, the radars look along its y axis, and so does who
carries it: the platform of a scene, x forward, is the base turned by -90 degrees. The
extrinsics are those of ColoRadar's calib folder (formats and sources: Kramer et al.
2022; published in issue 13 of ZJU-FAST-Lab/Radar-Diffusion).

The radars' are plainly values of the design: both have one quaternion, without tilt.
How far the mounts were from it nobody has measured; the radars here sit as mounts do
that were set up by ruler, some 1 degree and 1.5 cm off what `calib` says.
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from jradar.lidar import rigid_transform
from jradar.simulation.echoes import Viewpoint
from jradar.simulation.motion import Motion, pose_at, velocity_at

EXTRINSICS = {  # base from sensor: x y z, then quaternion x y z w
    "single_chip": ((-0.145, 0.09, -0.025), (0, 0, 0.706825181105, 0.707388269167)),
    "cascade": ((0.03, 0.12, -0.09), (0, 0, 0.706825181105, 0.707388269167)),
    "lidar": ((-0.075, -0.02, 0.03618), (0, 0, 0.721382357437, -0.692536998563)),
    "imu": (
        (0.0, 0.0, 0.0),
        (0.707105451466, 0.707108048814, 0.000209535067884, 0.00020953429822),
    ),
    # Of the Livox's own rig, not ColoRadar's: forward and tilted down by 25 degrees.
    "livox": ((0.0, 0.05, 0.10), (-0.15304592, 0.15304592, 0.69034553, 0.69034553)),
}
PLATFORM_FROM_BASE = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])


MISMOUNTED = ("single_chip", "cascade")
MOUNT_DEGREES, MOUNT_M = 1.0, 0.015  # off the design, rms over all three axes


def base_from(sensor: str) -> Float[np.ndarray, "4 4"]:
    """Transform from a sensor's frame to the base, as it truly is."""
    return rigid_transform(*map(np.array, EXTRINSICS[sensor])) @ mount_error(sensor)


def mount_error(sensor: str) -> Float[np.ndarray, "4 4"]:
    """From where the sensor truly sits to where `calib` says."""
    error = np.eye(4)
    if sensor in MISMOUNTED:
        random = np.random.default_rng([3, *sensor.encode()])
        turn, shift = random.standard_normal((2, 3)) / 3**0.5
        turn = Rotation.from_rotvec(np.radians(MOUNT_DEGREES) * turn)
        error[:3, :3], error[:3, 3] = turn.as_matrix(), MOUNT_M * shift
    return error


def sensor_pose(
    platform: Motion, sensor: str, time_s: Float[np.ndarray, "*batch"] | float
) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 3 3"]]:
    """Position and rotation of a sensor (or "base") in the world."""
    xyz, turn = pose_at(platform, time_s)
    turn = turn @ PLATFORM_FROM_BASE
    if sensor == "base":
        return xyz, turn
    mount = base_from(sensor)
    return xyz + turn @ mount[:3, 3], turn @ mount[:3, :3]


def viewpoint(platform: Motion, sensor: str, time_s: float) -> Viewpoint:
    """A radar's place and velocity at one time, its lever arm included."""
    xyz, turn = sensor_pose(platform, sensor, float(time_s))
    velocity, spin = velocity_at(platform, float(time_s))
    base, _ = pose_at(platform, float(time_s))
    return Viewpoint(xyz, turn, velocity + np.cross(spin, xyz - base))
