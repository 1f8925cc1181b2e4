"""The pitch of a radar's mount, from echoes that are surely single ones; host NumPy.

Few rows of antennas measure an elevation, and two echoes in one cell give one between
theirs. The velocity of all echoes then seems to climb or to sink. The snapshot of a
cell shows whether it holds a single plane wave, and only such cells count here. Over a
walk, each fits the Doppler of things that stand still,

    velocity = -(u_x, u_y, u_z) . (v_x, v_y, v_z)     u_z: sine of elevation - pitch

    v_z         of the poses, up to their noise: on the mean the rig neither climbs
    v_x, v_y    of the echoes themselves, frame by frame: poses are too noisy
    pitch       is what all frames share, next to a stretch of all elevations, which
                is what is left of echoes that are not quite single

Errors of elevations are errors of a regressor, so each echo counts at the elevation
that fits it best, between the measured one and that of its Doppler (Fuller 1987).
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from jradar.calibration.mount import BLOCK_S, Mount
from jradar.calibration.self_calibration import explain
from jradar.calibration.snapshots import strong_snapshots
from jradar.lidar import Poses
from jradar.motion.velocities import TO_DEVIATION
from jradar.recordings import Recording

SINGLE = 0.02  # share of the power that one plane wave may leave unexplained
HIGHEST = np.radians(60.0)  # elevation, beyond which two rows measure little
LEAST_AHEAD_MPS = 0.2
LEAST_ECHOES = 200
DOPPLER_MPS, ELEVATION = 0.02, np.radians(2.0)  # deviations of an echo's
POSE_MPS = np.array([0.3, 0.3, 0.05])  # deviations of the velocity of the poses
STRETCH = 0.03  # deviation of the stretch of elevations
CAUCHY = 2.0  # deviations, at which a residual counts half
SYSTEMATIC = np.radians(0.5)  # of the pitch, what all echoes of a walk share
MATCHED = np.radians(1.5)  # likewise by poses of matched scans
MOST_STEPS, CONVERGED = 60, 1e-6


class SingleEchoes(NamedTuple):
    """Strong echoes of each frame; those that are not single are not `known`."""

    stamps: Float[np.ndarray, " frame"]  # seconds, in the middle of the frame
    azimuth: Float[np.ndarray, "frame echo"]
    elevation: Float[np.ndarray, "frame echo"]
    range_m: Float[np.ndarray, "frame echo"]
    velocity: Float[np.ndarray, "frame echo"]  # m/s
    known: Bool[np.ndarray, "frame echo"]
    period_mps: float  # at which velocities fold


def single_echoes(
    recording: Recording,
    frames: Sequence[int],
    *,
    advance: Callable[[int], None] = lambda done: None,
) -> SingleEchoes:
    """Return the single echoes of frames of a calibrated radar, with known times."""
    radar, stamps = recording.radar, recording.cubes.stamps
    assert stamps is not None
    alike, rows = np.ones(radar.spec.num_virtual, np.complex64), []
    for done, frame in enumerate(frames, 1):
        echoes = strong_snapshots(recording.cube(frame), radar)
        found = explain(echoes.snapshot, alike, radar.spec)
        known = (echoes.power > 0) & (found.residual < SINGLE)
        place = found.azimuth, found.elevation, echoes.range_m
        rows.append((*place, echoes.velocity_mps, known))
        advance(done)
    columns = (np.stack([*map(np.asarray, c)]) for c in zip(*rows, strict=True))
    azimuth, elevation, range_m, velocity, known = columns
    return SingleEchoes(
        stamps=stamps[[*frames]] + radar.spec.frame_middle_s,
        azimuth=azimuth.astype(float),
        elevation=elevation.astype(float),
        range_m=range_m.astype(float) - float(radar.range_bias_m),
        velocity=velocity.astype(float),
        known=known & (np.abs(elevation) < HIGHEST),
        period_mps=2 * radar.spec.max_velocity_mps,
    )


def with_pitch(
    mount: Mount, echoes: SingleEchoes, poses: Poses, *, matched: bool = False
) -> Mount:
    """Return a mount whose rotation about the radar's y axis explains the echoes.

    It is unchanged if the echoes show the pitch no better than the mount does, such as
    with fewer than 200 of them while the radar moves along its x axis.
    """
    expected = _velocities(mount, echoes.stamps, poses)
    fast = np.abs(np.nan_to_num(expected[:, 0])) > LEAST_AHEAD_MPS
    used = echoes.known & fast[:, None]
    if used.sum() < LEAST_ECHOES:
        return mount
    walk = _Walk.of(echoes, used, np.nan_to_num(expected))
    pitch, noise = _fit(walk)
    deviation = mount.deviation.copy()
    deviation[1] = np.hypot(noise, MATCHED if matched else SYSTEMATIC)
    if deviation[1] >= mount.deviation[1]:
        return mount
    return mount.rotated(Rotation.from_euler("y", pitch).as_matrix(), deviation)


class _Walk(NamedTuple):
    """Echoes in one row, and what the poses say of each frame."""

    frame: np.ndarray
    velocity: np.ndarray
    across: np.ndarray  # u_y of each echo
    within: np.ndarray  # length of its direction in the plane of x and z
    angle: np.ndarray  # in that plane, as measured
    expected: np.ndarray  # [frame, 3], m/s
    block: np.ndarray  # [frame], of frames that may be alike
    period_mps: float

    @classmethod
    def of(cls, echoes: SingleEchoes, used: np.ndarray, expected: np.ndarray):
        azimuth, elevation = echoes.azimuth[used], echoes.elevation[used]
        across = np.sin(azimuth) * np.cos(elevation)
        within = np.sqrt(1 - across**2)
        return cls(
            np.nonzero(used)[0],
            echoes.velocity[used],
            across,
            within,
            np.arcsin(np.clip(np.sin(elevation) / within, -1, 1)),
            expected,
            ((echoes.stamps - echoes.stamps[0]) / BLOCK_S).astype(int),
            echoes.period_mps,
        )

    def total(self, *columns: np.ndarray) -> np.ndarray:
        """Sums over the echoes of each frame [frame, column]."""
        count = len(self.expected)
        return np.stack([np.bincount(self.frame, c, count) for c in columns], -1)


def _fit(walk: _Walk) -> tuple[float, float]:
    """The pitch and its deviation by Gauss-Newton; each frame has its own velocity."""
    shared, own = np.zeros(2), walk.expected.copy()  # pitch and stretch; velocities
    prior, known = np.diag([0.0, STRETCH**-2]), np.diag(POSE_MPS**-2.0)
    score, inverse = np.zeros((len(own), 2)), np.eye(2)
    for _ in range(MOST_STEPS):
        residual, weight, slope, slope_own = _linearised(walk, shared, own)
        weighted = weight[:, None] * slope_own
        square = walk.total(
            *(weighted[:, :, None] * slope_own[:, None]).reshape(-1, 9).T
        )
        mixed = walk.total(*(weighted[:, :, None] * slope[:, None]).reshape(-1, 6).T)
        square, mixed = square.reshape(-1, 3, 3) + known, mixed.reshape(-1, 3, 2)
        side = walk.total(*(weighted * residual[:, None]).T)
        side += (own - walk.expected) @ known
        solved = np.linalg.solve(square, np.concatenate([side[..., None], mixed], -1))
        alone, carried = solved[..., 0], solved[..., 1:]
        score = walk.total(*(weight * residual * slope.T))
        score -= np.einsum("fia,fi->fa", mixed, alone)
        normal = slope.T @ (weight[:, None] * slope) + prior
        inverse = np.linalg.inv(normal - np.einsum("fia,fib->ab", mixed, carried))
        step = -inverse @ (score.sum(0) + prior @ shared)
        shared, own = shared + step, own - alone - carried @ step
        if np.abs(step).max() < CONVERGED:
            break
    sums = np.zeros((walk.block.max() + 1, 2))
    np.add.at(sums, walk.block, score)
    alike = inverse @ (sums.T @ sums) @ inverse
    return float(shared[0]), float(np.sqrt(max(inverse[0, 0], alike[0, 0])))


def _linearised(walk: _Walk, shared: np.ndarray, own: np.ndarray):
    """Residuals, robust weights, and slopes by pitch and stretch, and by velocity."""
    pitch, stretch = shared
    ahead, left, up = own[walk.frame].T
    angle = walk.angle * (1 + stretch) - pitch

    def by_angle(at: np.ndarray) -> np.ndarray:
        return walk.within * (np.cos(at) * up - np.sin(at) * ahead)

    along = walk.within * (np.cos(angle) * ahead + np.sin(angle) * up)
    residual = walk.velocity + along + walk.across * left
    residual -= walk.period_mps * np.round(residual / walk.period_mps)
    slope = by_angle(angle)
    variance = DOPPLER_MPS**2 + (ELEVATION * slope) ** 2
    off = np.abs(residual) / np.sqrt(variance)
    scale = max(1.0, TO_DEVIATION * float(np.median(off)))
    weight = 1 / (1 + (off / scale / CAUCHY) ** 2) / (variance * scale**2)
    angle = angle - residual * slope * ELEVATION**2 / variance  # that fits best
    slope = by_angle(angle)
    cosine, sine = walk.within * np.cos(angle), walk.within * np.sin(angle)
    slope_own = np.stack([cosine, walk.across, sine], -1)
    return residual, weight, np.stack([-slope, slope * walk.angle], -1), slope_own


def _velocities(mount: Mount, stamps: np.ndarray, poses: Poses) -> np.ndarray:
    """The radar's velocity [frame, 3] along its axes, by poses; NaN outside of them."""
    origin = poses.stamps[0]
    times, at = poses.stamps - origin, stamps - origin + mount.offset_s
    turns, inside = Rotation.from_quat(poses.quaternion), np.clip(at, 0, times[-1])
    course = RotationSpline(times, turns)
    world = CubicSpline(times, poses.xyz)(inside, 1)
    base = course(inside).inv().apply(world)
    arm = np.cross(course(inside, 1), mount.base_from_radar[:3, 3])
    moved = (base + arm) @ mount.base_from_radar[:3, :3]
    return np.where((at == inside)[:, None], moved, np.nan)
