"""The roll of a radar's mount, from single echoes on surfaces of a LiDAR; host NumPy.

Directions of travel do not show a rotation about the direction itself. Walls and floors
do. The scans of a walk, each at its pose, become a map of small planes, and an echo
that is surely single lies on one of them:

    residual = normal . (pose . mount . echo - point)

Its deviation follows from those of the echo's range, azimuth and elevation. Place,
pitch and yaw are known better from the motion, and move only within their deviations;
so does a range bias.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from jradar.calibration.mount import BLOCK_S, Mount
from jradar.calibration.pitch import SingleEchoes
from jradar.lidar import Poses, interpolate_poses, returns
from jradar.recordings import Recording

MOST_SCANS = 150
NEAR_M, FAR_M = 0.7, 10.0  # of echoes; scans are kept half as far again
VOXEL_M, LEAST_POINTS = 0.1, 3  # of the map
NEIGHBOURS, FLAT = 12, 0.1  # of a plane, and its thickness: share of the next variance
FARTHEST_M = 1.0  # of an echo from its surface
SURFACE_M, RANGE_M = 0.04, 0.04  # deviations
AZIMUTH, ELEVATION = np.radians(1.0), np.radians(3.0)
BIAS_M = 0.1  # of the range, as a radar comes
CAUCHY = 2.0  # deviations, at which a residual counts half
SYSTEMATIC = np.radians(0.8)  # of the roll, what all echoes of a walk share
LEAST_ECHOES = 50
MOST_STEPS, CONVERGED = 60, 1e-5


class Surfaces(NamedTuple):
    """Small planes of the world, in its frame."""

    tree: KDTree  # of the points
    xyz: Float[np.ndarray, "plane 3"]
    normal: Float[np.ndarray, "plane 3"]
    flat: Bool[np.ndarray, " plane"]  # edges and clutter have no normal


def surfaces_of(
    recording: Recording,
    poses: Poses,
    *,
    scan_s: float = 0.1,
    advance: Callable[[int], None] = lambda done: None,
) -> Surfaces | None:
    """Return the surfaces that the LiDAR saw; None without scans, times or its place.

    Scans are taken at the pose in their middle.
    """
    lidar, mount = recording.lidar, recording.base_from_lidar
    if lidar is None or lidar.stamps is None or mount is None:
        return None
    stamps = np.asarray(lidar.stamps) + scan_s / 2
    at = interpolate_poses(poses, stamps)
    known = np.flatnonzero(np.isfinite(at[:, 0, 0]))
    parts = []
    for done, k in enumerate(known[:: -(-len(known) // MOST_SCANS) or 1], 1):
        xyz = np.asarray(lidar[int(k)][:, :3], float)
        xyz = xyz[returns(xyz)]
        xyz = xyz[np.linalg.norm(xyz, axis=1) < 1.5 * FAR_M]
        matrix = at[k] @ mount
        parts.append(_thinned(xyz @ matrix[:3, :3].T + matrix[:3, 3]))
        advance(done)
    weights = np.concatenate([np.zeros(0), *(count for _, count in parts)])
    xyz = np.concatenate([np.zeros((0, 3)), *(xyz for xyz, _ in parts)])
    xyz, count = _thinned(xyz, weights)
    xyz = xyz[count >= LEAST_POINTS]
    if len(xyz) < NEIGHBOURS:
        return None
    tree = KDTree(xyz)
    _, near = tree.query(xyz, k=NEIGHBOURS)
    around = xyz[near] - xyz[near].mean(1, keepdims=True)
    variance, axes = np.linalg.eigh(np.einsum("pki,pkj->pij", around, around))
    return Surfaces(tree, xyz, axes[:, :, 0], variance[:, 0] < FLAT * variance[:, 1])


def _thinned(xyz, weights=None):
    """The mean of the points in each voxel, and their number."""
    voxel = np.floor(xyz / VOXEL_M).astype(int)
    _, of = np.unique(voxel, axis=0, return_inverse=True)
    of = of.ravel()
    weights = np.ones(len(xyz)) if weights is None else weights
    count = np.bincount(of, weights)
    sums = [np.bincount(of, weights * column) for column in xyz.T]
    return np.stack(sums, -1) / count[:, None], count


def with_roll(
    mount: Mount, echoes: SingleEchoes, surfaces: Surfaces, poses: Poses
) -> Mount:
    """Return a mount whose rotation about the radar's x axis puts echoes on surfaces.

    It is unchanged if they show the roll no better than the mount does, such as fewer
    than 50 near a surface.
    """
    stamps = echoes.stamps + mount.offset_s
    at = interpolate_poses(poses, stamps)
    used = echoes.known & np.isfinite(at[:, :1, 0])
    used &= (echoes.range_m > NEAR_M) & (echoes.range_m < FAR_M)
    if used.sum() < LEAST_ECHOES:
        return mount
    walk = _Walk.of(echoes, used, at)
    found = _fit(walk, mount, surfaces)
    if found is None:
        return mount
    roll, noise = found
    deviation = mount.deviation.copy()
    deviation[0] = np.hypot(noise, SYSTEMATIC)
    if deviation[0] >= mount.deviation[0]:
        return mount
    return mount.rotated(Rotation.from_euler("x", roll).as_matrix(), deviation)


class _Walk(NamedTuple):
    """Echoes in one row; directions are along the radar's axes."""

    range_m: np.ndarray
    toward: np.ndarray
    left: np.ndarray  # along which the azimuth grows
    up: np.ndarray  # and the elevation
    pose: np.ndarray  # of the base, [echo, 4, 4]
    block: np.ndarray  # of echoes that may be alike

    @classmethod
    def of(cls, echoes: SingleEchoes, used: np.ndarray, at: np.ndarray):
        frame, _ = np.nonzero(used)
        azimuth, elevation = echoes.azimuth[used], echoes.elevation[used]
        sine, cosine = np.sin(azimuth), np.cos(azimuth)
        ground, high = np.cos(elevation), np.sin(elevation)
        block = (echoes.stamps - echoes.stamps[0]) / BLOCK_S
        return cls(
            echoes.range_m[used],
            np.stack([ground * cosine, ground * sine, high], -1),
            np.stack([-sine, cosine, np.zeros_like(sine)], -1),
            np.stack([-high * cosine, -high * sine, ground], -1),
            at[frame],
            block.astype(int)[frame],
        )


def _fit(walk: _Walk, mount: Mount, surfaces: Surfaces) -> tuple[float, float] | None:
    """The roll and its deviation, by Gauss-Newton; None for too few echoes."""
    prior = np.diag(np.r_[mount.deviation[:6], BIAS_M] ** -2.0)
    described = mount.base_from_radar
    matrix, bias = described.copy(), 0.0
    inverse, score, block = np.eye(7), np.zeros((0, 7)), np.zeros(0, int)
    for _ in range(MOST_STEPS):
        local = (walk.range_m - bias)[:, None] * walk.toward
        base = local @ matrix[:3, :3].T + matrix[:3, 3]
        world = np.einsum("eij,ej->ei", walk.pose[:, :3, :3], base)
        world += walk.pose[:, :3, 3]
        apart, plane = surfaces.tree.query(world, distance_upper_bound=FARTHEST_M)
        near = np.isfinite(apart)
        near[near] = surfaces.flat[plane[near]]
        if near.sum() < LEAST_ECHOES:
            return None
        normal, plane = surfaces.normal[plane[near]], plane[near]
        residual = ((world[near] - surfaces.xyz[plane]) * normal).sum(1)
        of_base = np.einsum("eji,ej->ei", walk.pose[near][:, :3, :3], normal)
        of_radar = of_base @ matrix[:3, :3]
        head_on = (of_radar * walk.toward[near]).sum(1)
        slope = np.concatenate(
            [np.cross(local[near], of_radar), of_base, -head_on[:, None]], 1
        )
        reach = walk.range_m[near]
        across = AZIMUTH * reach * (of_radar * walk.left[near]).sum(1)
        above = ELEVATION * reach * (of_radar * walk.up[near]).sum(1)
        variance = SURFACE_M**2 + (RANGE_M * head_on) ** 2 + across**2 + above**2
        weight = 1 / (1 + residual**2 / variance / CAUCHY**2) / variance
        moved = _moved(described, matrix, bias)
        score = (weight * residual)[:, None] * slope
        inverse = np.linalg.inv(slope.T @ (weight[:, None] * slope) + prior)
        step = -inverse @ (score.sum(0) + prior @ moved)
        matrix = matrix.copy()
        matrix[:3, :3] = matrix[:3, :3] @ Rotation.from_rotvec(step[:3]).as_matrix()
        matrix[:3, 3] += step[3:6]
        bias, block = bias + step[6], walk.block[near]
        if np.abs(step).max() < CONVERGED:
            break
    sums = np.zeros((walk.block.max() + 1, 7))
    np.add.at(sums, block, score)
    alike = inverse @ (sums.T @ sums + prior) @ inverse
    roll = _moved(described, matrix, bias)[0]
    return float(roll), float(np.sqrt(max(inverse[0, 0], alike[0, 0])))


def _moved(before: np.ndarray, matrix: np.ndarray, bias: float) -> np.ndarray:
    """Rotation about the radar's axes, place along the base's, and the range bias."""
    turn = Rotation.from_matrix(before[:3, :3].T @ matrix[:3, :3]).as_rotvec()
    return np.r_[turn, matrix[:3, 3] - before[:3, 3], bias]
