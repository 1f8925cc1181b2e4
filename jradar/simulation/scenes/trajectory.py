"""How platforms, people and cars move: closed loops at a varying pace, with sway.

A trajectory follows a smooth closed curve at a pace that swings about its mean. A rig
carried by hand also bobs and rolls at the rate of the steps, and looks around slowly.
All terms are smooth functions of time; velocities are their differences, accurate to
1e-6 m/s at any time.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

STEP_S = 1e-4  # of the central differences


class Sway(NamedTuple):
    """Sums of sines added to x, y, z (metres) and roll, pitch, yaw (radians)."""

    amplitude: Float[np.ndarray, "term 6"]
    frequency_hz: Float[np.ndarray, " term"]
    phase: Float[np.ndarray, "term 6"]


class Trajectory(NamedTuple):
    """A body's path through the world; its frame is x forward, y left, z up."""

    curve: CubicSpline  # metres along the loop to x y z
    length_m: float
    speed_mps: float
    start_m: float
    surge: Float[np.ndarray, " surge"]  # share of the speed, frequency in Hz, phase
    sway: Sway


STILL = Sway(np.zeros((1, 6)), np.ones(1), np.zeros((1, 6)))


def loop(waypoints: Float[np.ndarray, "corner 3"], *, rounding_m: float) -> CubicSpline:
    """Return a closed curve through rounded corners, by metres from the first."""
    closed = np.vstack([waypoints, waypoints[:1]])
    legs = np.linalg.norm(np.diff(closed, axis=0), axis=-1)
    at = np.r_[0, np.cumsum(legs)]
    step = min(0.2, rounding_m / 3)
    fine = np.linspace(0, at[-1], max(int(at[-1] / step), 16), endpoint=False)
    points = np.stack([np.interp(fine, at, column) for column in closed.T], -1)
    spacing = at[-1] / len(fine)
    points = gaussian_filter1d(points, rounding_m / spacing, axis=0, mode="wrap")
    points = np.vstack([points, points[:1]])
    metres = np.r_[0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=-1))]
    return CubicSpline(metres, points, bc_type="periodic")


def walk(
    random: np.random.Generator,
    waypoints: Float[np.ndarray, "corner 3"],
    *,
    speed_mps: float,
    rounding_m: float = 0.5,
    hand_held: bool = False,
) -> Trajectory:
    """Return a trajectory that starts at a random place; `hand_held` adds sway."""
    curve = loop(np.asarray(waypoints, float), rounding_m=rounding_m)
    length = float(curve.x[-1])
    surge = np.array([0.25, 0.15 + 0.1 * random.random(), 2 * np.pi * random.random()])
    sway = hand_sway(random) if hand_held else STILL
    return Trajectory(curve, length, speed_mps, length * random.random(), surge, sway)


def hand_sway(random: np.random.Generator) -> Sway:
    """Return the sway of a rig carried by hand: steps of 1.8 Hz, strides, slow gaze."""
    degree = np.pi / 180
    amplitude = np.array(
        [
            [0.010, 0.005, 0.020, 0.6 * degree, 0.9 * degree, 0.4 * degree],  # steps
            [0.003, 0.020, 0.004, 1.2 * degree, 0.4 * degree, 1.2 * degree],  # strides
            [0.000, 0.030, 0.010, 0.8 * degree, 1.2 * degree, 6.0 * degree],  # gaze
            [0.000, 0.010, 0.005, 0.4 * degree, 0.6 * degree, 3.0 * degree],
        ]
    )
    step = random.uniform(1.6, 2.0)
    slow, slower = random.uniform(0.25, 0.4), random.uniform(0.08, 0.15)
    amplitude = amplitude * random.uniform(0.6, 1.4, amplitude.shape)
    phase = random.uniform(0, 2 * np.pi, amplitude.shape)
    return Sway(amplitude, np.array([step, step / 2, slow, slower]), phase)


def mounted(
    trajectory: Trajectory,
    *,
    raised_m: float = 0.0,
    tilt_rad: float = 0.0,
    yaw_rad: float = 0.0,
    speed_mps: float | None = None,
) -> Trajectory:
    """Return the trajectory at another height, tilt, direction or pace.

    A speed of 0 also ends the sway: the rig stands on a tripod. The offsets are a
    constant term of the sway.
    """
    sway = trajectory.sway
    if speed_mps is not None:
        trajectory = trajectory._replace(speed_mps=speed_mps)
        sway = sway if speed_mps else STILL
    fixed = np.array([[0.0, 0.0, raised_m, 0.0, tilt_rad, yaw_rad]])
    sway = Sway(
        np.concatenate([sway.amplitude, fixed]),
        np.append(sway.frequency_hz, 0.0),
        np.concatenate([sway.phase, np.full((1, 6), np.pi / 2)]),
    )
    return trajectory._replace(sway=sway)


def pose_at(
    trajectory: Trajectory, time_s: Float[np.ndarray, "*batch"] | float
) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 3 3"]]:
    """Return the position in the world and the rotation from the body's frame."""
    time_s = np.asarray(time_s, float)
    share, frequency, phase = trajectory.surge
    turns = 2 * np.pi * frequency
    metres = trajectory.start_m + trajectory.speed_mps * (
        time_s + share / turns * np.sin(turns * time_s + phase)
    )
    at = np.mod(metres, trajectory.length_m)
    xyz, tangent = trajectory.curve(at), trajectory.curve(at, 1)
    cycles = 2 * np.pi * trajectory.sway.frequency_hz[:, None] * time_s[..., None, None]
    added = (trajectory.sway.amplitude * np.sin(cycles + trajectory.sway.phase)).sum(-2)
    heading = np.arctan2(tangent[..., 1], tangent[..., 0])
    angles = np.stack([heading + added[..., 5], added[..., 4], added[..., 3]], -1)
    turn = Rotation.from_euler("ZYX", angles.reshape(-1, 3)).as_matrix()
    return xyz + added[..., :3], turn.reshape(*time_s.shape, 3, 3)


def velocity_at(
    trajectory: Trajectory, time_s: Float[np.ndarray, "*batch"] | float
) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 3"]]:
    """Return velocity and angular velocity in the world, m/s and rad/s."""
    time_s = np.asarray(time_s, float)
    before, after = (pose_at(trajectory, time_s + side) for side in (-STEP_S, STEP_S))
    change = after[1] @ before[1].swapaxes(-1, -2)
    turned = Rotation.from_matrix(change.reshape(-1, 3, 3)).as_rotvec()
    return (
        (after[0] - before[0]) / (2 * STEP_S),
        turned.reshape(*time_s.shape, 3) / (2 * STEP_S),
    )
