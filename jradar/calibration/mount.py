"""The radar's place on its rig, from two measurements of one motion; host NumPy.

Echoes that stand still give the radar's velocity along its own axes. Poses of the base,
recorded or of matched LiDAR scans, give the base's velocity v and rate w along the
base's axes. With the radar's rotation R and position p on the base,

    v_radar(t) = R^T (v(t + offset) + w(t + offset) x p)

Directions of travel show R, rotations of the rig show p, and changes of speed show the
offset of the clocks. What a walk does not show stays as described: a walk straight
ahead, for example, does not show p. Of R, the mount takes the yaw alone. Floors,
ceilings and phase errors shift the few elevations that an array measures, so pitch and
roll are fitted with the rest, but stay as described.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation, RotationSpline

from jradar.lidar import Poses
from jradar.motion import Velocities
from jradar.motion.velocities import TO_DEVIATION

# Axes of the fit: rotation about x, y, z of the radar, place along x, y, z of the base,
# and the offset of the clocks. A walk shows an axis if its deviation is within LIMITS;
# that of a description is DESCRIBED. A mount has the axes from the third on.
LIMITS = np.array([np.radians(1.0)] * 3 + [0.05] * 3 + [0.02])
DESCRIBED = np.array([np.radians(10.0)] * 3 + [0.2] * 3 + [0.2])
LEAST_FRAMES, LEAST_POSES = 20, 10
LEAST_SPEED_MPS = 0.1
LARGEST_SHARE = 0.4  # of the speed, by which both may differ
TURNED_DEG = 90.0  # from the description: more than a measuring error
LARGEST_OFFSET_S, OFFSET_STEP_S = 0.5, 0.05  # of those that are tried first
# Errors that all frames share do not show in residuals: floors and ceilings shift the
# elevations that few rows of antennas measure, ghosts the azimuths. The numbers are
# errors of a calibrated AWR1843 in ten simulated walks.
SYSTEMATIC = np.array([*np.radians([2.0, 1.7, 0.6]), 0.005, 0.005, 0.005, 0.0])
# The same with poses of matched scans, whose errors look like motion.
MATCHED = np.array([*np.radians([8.0, 2.5, 0.8]), 0.05, 0.05, 0.1, 0.03])
NOISE_MPS = 0.03  # of a velocity, on top of its own deviation
HUBER = 2.0  # deviations, from where a residual counts less
BLOCK_S = 2.0  # residuals within it may be alike
FINE = 4  # samples of the smoothed motion in each width of the filter
FIRM = 1e-3  # share of its deviation, of a description that is kept
STEP = 1e-3  # of the slopes, in limits
PREFER_SMALL = 0.01  # deviations a radian and a second


AXES = (  # name, unit, and its size in SI units
    ("rotation about the radar's z", "deg", np.pi / 180),
    *((f"position along the base's {axis}", "m", 1.0) for axis in "xyz"),
    ("time to add to the radar's start", "s", 1.0),
)
PITCH_AND_ROLL = "the pitch and roll of the mount: they stay as described"
MOTIONS = (
    "the radar hardly moved over the ground: walk ahead",
    "the rig rotated too little: turn left and right by 180 degrees or more in all",
    "the rig hardly tilted: nod and roll it by 20 degrees while walking",
    "the speed hardly changed: stop and walk on several times",
)

MATCHED_SCANS = (
    "the poses are those of matched LiDAR scans: they show the rotation about the "
    "radar's z axis, its yaw, and little else. For more, record the poses of a better "
    "source, and name them in capture.toml"
)


class Mount(NamedTuple):
    """The place of a radar on its base, and how well a walk shows it.

    Where a walk shows nothing, the mount is as described, and as uncertain.
    """

    base_from_radar: Float[np.ndarray, "4 4"]
    offset_s: float  # to add to the radar's stamps
    rotated: float  # rad, from the described orientation to that of the motion
    deviation: Float[np.ndarray, " 5"]  # of AXES, in SI units
    stamps: Float[np.ndarray, " frame"]
    velocity: Float[np.ndarray, "frame 3"]  # of the radar by Doppler, m/s
    expected: Float[np.ndarray, "frame 3"]  # by the poses and this mount, m/s

    @property
    def observed(self) -> Bool[np.ndarray, " 5"]:
        """The axes that the walk shows within `LIMITS`."""
        return self.deviation <= LIMITS[2:]

    def missing(self) -> tuple[str, ...]:
        """Return the motions that would show the axes that this walk does not show."""
        hidden = ~self.observed
        groups = hidden[0], hidden[1:3].any(), hidden[3], hidden[4]
        return tuple(m for m, lacks in zip(MOTIONS, groups, strict=True) if lacks)

    def describe(self) -> dict[str, Any]:
        """Return the place, each axis with its deviation, and what the walk lacks."""
        turn = Rotation.from_matrix(self.base_from_radar[:3, :3])
        yaw = turn.as_euler("xyz")[2]
        values = np.r_[yaw, self.base_from_radar[:3, 3], self.offset_s]
        return {
            "mount": [
                {
                    "axis": f"{name} ({unit})",
                    "value": float(value / size),
                    "deviation": float(deviation / size),
                    "shown by the walk": bool(shown),
                }
                for (name, unit, size), value, deviation, shown in zip(
                    AXES, values, self.deviation, self.observed, strict=True
                )
            ],
            "velocities differ from the poses by (m/s)": float(
                np.sqrt(np.mean((self.velocity - self.expected) ** 2))
            ),
            "motion that would show more": list(self.missing()),
        }

    def warnings(self, *, matched: bool = False) -> tuple[str, ...]:
        """Return what contradicts the description or the deviations, in words.

        Poses were `matched` if they are those of LiDAR scans.
        """
        turned_deg = float(np.degrees(self.rotated))
        found = (MATCHED_SCANS,) if matched else ()
        if turned_deg < TURNED_DEG:
            return found
        return (
            *found,
            f"the walk contradicts the described orientation of the radar by "
            f"{turned_deg:.0f} degrees. If it is mounted upside down, write "
            "`upside_down = true` in the table [radar] of its TOML description, and "
            "keep its z axis up in rpy_degrees",
        )


def mount_from_motion(
    velocities: Velocities,
    poses: Poses,
    described: Float[np.ndarray, "4 4"],
    *,
    matched: bool = False,
) -> Mount:
    """Return the mount that explains a radar's velocities by the poses of its base.

    `described` is base_from_radar as far as it is known. Errors of its yaw and place
    are found where the walk shows them. Poses of LiDAR scans are `matched`: their
    errors look like motion. Raises ValueError for fewer than 20 frames with a
    velocity within the poses.
    """
    if len(poses.stamps) < LEAST_POSES:
        raise ValueError(f"{len(poses.stamps)} poses, expected {LEAST_POSES} or more")
    first, last = poses.stamps[[0, -1]]
    measured = velocities.velocity
    used = np.isfinite(measured).all(1)
    used &= (velocities.stamps >= first) & (velocities.stamps <= last)
    if used.sum() < LEAST_FRAMES:
        raise ValueError(
            f"{used.sum()} frames with a velocity within the poses from {first:.3f} to "
            f"{last:.3f} s, expected {LEAST_FRAMES} or more: do the clocks agree?"
        )
    walk = _both_smoothed(velocities, poses, used)
    if walk.speed < LEAST_SPEED_MPS:
        raise ValueError(
            f"the radar moves by {walk.speed:.2f} m/s, expected {LEAST_SPEED_MPS} m/s "
            "or more: walk ahead and turn, among things that stand still"
        )
    prior = mount, offset = _start(walk, described)
    scale = 1.0
    for _ in range(3):  # the deviation of residuals follows from the fit before
        mount, offset = _fit(walk, mount, offset, scale, prior)
        scale = _scale(walk.residual(mount, offset))
    systematic = MATCHED if matched else SYSTEMATIC
    deviation = np.hypot(_deviations(walk, mount, offset, scale), systematic)
    kept = deviation > DESCRIBED / 2  # noise would only move it
    if kept.any():
        known = np.where(kept, DESCRIBED * FIRM, DESCRIBED)
        mount, offset = _fit(walk, mount, offset, scale, prior, known)
        deviation = np.where(kept, DESCRIBED, deviation)
    expected = walk.expected(mount, offset)
    off = float(np.median(np.linalg.norm(walk.velocity - expected, axis=1)))
    if off > LARGEST_SHARE * walk.speed:
        raise ValueError(
            f"the radar's velocities and the poses differ by {off:.2f} m/s at "
            f"{walk.speed:.2f} m/s, whatever the mount: are the clocks within "
            f"{LARGEST_OFFSET_S} s, and did scan matching hold?"
        )
    turn = described[:3, :3].T @ mount[:3, :3]
    yaw = np.arctan2(turn[1, 0], turn[0, 0])
    mount[:3, :3] = described[:3, :3] @ Rotation.from_euler("z", yaw).as_matrix()
    return Mount(
        base_from_radar=mount,
        offset_s=offset,
        rotated=float(Rotation.from_matrix(turn).magnitude()),
        deviation=deviation[2:],
        stamps=walk.stamps,
        velocity=walk.velocity,
        expected=expected,
    )


def _both_smoothed(velocities: Velocities, poses: Poses, used: np.ndarray) -> "_Walk":
    """Return what both measured after one filter, which the equation allows.

    Without it, poses would be less noisy halfway between their stamps than at them, and
    the offset would be drawn there.
    """
    origin = poses.stamps[0]  # small numbers have fine steps
    stamps, times = velocities.stamps[used] - origin, poses.stamps - origin
    width = float(max(np.median(np.diff(stamps)), np.median(np.diff(times))))
    turns = Rotation.from_quat(poses.quaternion)
    along = turns.inv().apply(CubicSpline(times, poses.xyz)(times, 1))
    moved = np.concatenate([along, RotationSpline(times, turns)(times, 1)], 1)
    fine = np.linspace(times[0], times[-1], int(np.ptp(times) / width * FINE) + 2)
    course = CubicSpline(fine, _smooth(times, moved, fine, width))

    def motion(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        smooth = course(np.clip(at, *times[[0, -1]]))
        return smooth[:, :3], smooth[:, 3:]

    covariance = velocities.covariance[used].reshape(-1, 9)
    columns = np.concatenate([velocities.velocity[used], covariance], 1)
    known = np.all(np.isfinite(columns), axis=0)
    smooth = _smooth(stamps, np.where(known, columns, 0.0), stamps, width)
    weight = _whitening(smooth[:, 3:].reshape(-1, 3, 3), known[3::4])
    return _Walk(stamps, smooth[:, :3], weight, motion)


def _smooth(times, values, at, width):
    """Local lines through `values` [time, column], with a Gaussian of this `width`."""
    apart = (times - at[:, None]) / width
    kernel = np.exp(-0.5 * apart**2)
    zeroth, first, second = ((kernel * apart**k).sum(1) for k in range(3))
    bend = np.maximum(zeroth * second - first**2, 1e-9)
    return kernel * (second[:, None] - first[:, None] * apart) / bend[:, None] @ values


class _Walk(NamedTuple):
    """What both sensors measured."""

    stamps: np.ndarray
    velocity: np.ndarray  # of the radar [frame, 3]
    weight: np.ndarray  # [frame, 3, 3], of velocities to deviations
    motion: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]  # of the base

    def expected(self, mount: np.ndarray, offset_s: float) -> np.ndarray:
        """The radar's velocities [frame, 3] by the poses."""
        velocity, rate = self.motion(self.stamps + offset_s)
        return (velocity + np.cross(rate, mount[:3, 3])) @ mount[:3, :3]

    @property
    def speed(self) -> float:
        """The median speed of the radar in m/s."""
        return float(np.median(np.linalg.norm(self.velocity, axis=1)))

    def residual(self, mount: np.ndarray, offset_s: float) -> np.ndarray:
        """The differences in deviations, flat."""
        off = self.velocity - self.expected(mount, offset_s)
        return np.einsum("fij,fj->fi", self.weight, off).ravel()

    def scores(
        self, mount: np.ndarray, offset_s: float, scale: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Slopes [residual, axis] by the limits, and residuals; robustly weighted."""
        value = self.residual(mount, offset_s)
        slope = [
            self.residual(*_moved(mount, offset_s, side)) for side in STEP * np.eye(7)
        ]
        slope = (np.stack(slope, -1) - value[:, None]) / STEP
        weight = np.minimum(1.0, HUBER * scale / np.maximum(np.abs(value), 1e-12))
        return slope * np.sqrt(weight)[:, None], value * np.sqrt(weight)


def _start(walk, described):
    """The best of 24 right-angled rotations of the description, and of offsets.

    Of rotations and offsets that explain equally much, the smallest is taken.
    """
    tried, costs = [], []
    offsets = np.arange(-LARGEST_OFFSET_S, LARGEST_OFFSET_S + 1e-9, OFFSET_STEP_S)
    for rotation in Rotation.create_group("O"):
        mount = described.copy()
        mount[:3, :3] = described[:3, :3] @ rotation.as_matrix()
        for offset in offsets:
            cost = np.abs(walk.residual(mount, offset)).mean()
            tried.append((mount, float(offset)))
            costs.append(cost + PREFER_SMALL * (rotation.magnitude() + abs(offset)))
    return tried[int(np.argmin(costs))]


def _whitening(covariance, known):
    """Matrices [frame, 3, 3] that turn velocities into deviations; 0 for no axis."""
    values, vectors = np.linalg.eigh(covariance + NOISE_MPS**2 * np.eye(3))
    root = (vectors / np.sqrt(values)[:, None]) @ vectors.swapaxes(1, 2)
    return root * np.outer(known, known)


def _moved(mount, offset_s, step):
    """Mount and offset after a step in limits: rotated along its own axes, shifted."""
    step = step * LIMITS
    moved = mount.copy()
    turn = Rotation.from_rotvec(step[:3]).as_matrix()
    moved[:3, :3], moved[:3, 3] = mount[:3, :3] @ turn, mount[:3, 3] + step[3:6]
    return moved, offset_s + float(step[6])


def _fit(walk, mount, offset_s, scale, prior, known=DESCRIBED):
    """Mount and offset by robust least squares, with the prior as a measurement."""

    def residual(step: np.ndarray) -> np.ndarray:
        moved, offset = _moved(mount, offset_s, step)
        turn = Rotation.from_matrix(prior[0][:3, :3].T @ moved[:3, :3]).as_rotvec()
        away = np.r_[turn, moved[:3, 3] - prior[0][:3, 3], offset - prior[1]]
        return np.r_[walk.residual(moved, offset) / scale, away / known]

    found = least_squares(residual, np.zeros(7), loss="huber", f_scale=HUBER)
    return _moved(mount, offset_s, found.x)


def _scale(residual):
    """The deviation of residuals, robustly; those of unknown axes are 0."""
    return max(TO_DEVIATION * float(np.median(np.abs(residual[residual != 0]))), 1e-3)


def _deviations(walk, mount, offset_s, scale):
    """The standard deviations of the seven axes, in SI units.

    Residuals within two seconds may be alike, so their scores are summed before they
    are squared (Liang & Zeger 1986). The result is at least that of white noise.
    """
    slope, value = walk.scores(mount, offset_s, scale)
    prior = np.diag((LIMITS / DESCRIBED) ** 2)
    inverse = np.linalg.inv(slope.T @ slope / scale**2 + prior)
    block = np.floor((walk.stamps - walk.stamps[0]) / BLOCK_S).astype(int)
    sums = np.zeros((block[-1] + 1, len(LIMITS)))
    np.add.at(sums, np.repeat(block, 3), slope * value[:, None] / scale**2)
    filled = len(np.unique(block))
    alike = sums.T @ sums * filled / max(filled - len(LIMITS), 1)
    both = np.diagonal(inverse), np.diagonal(inverse @ (alike + prior) @ inverse)
    return LIMITS * np.sqrt(np.maximum(*both))
