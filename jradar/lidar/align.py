"""Poses and rigid transforms, on the host in float64.

A transform `a_from_b` is a 4 x 4 matrix that takes points of frame b to frame a, so
that `a_from_c = a_from_b @ b_from_c`. Quaternions are x y z w.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation, Slerp


class Poses(NamedTuple):
    """A trajectory: the moving frame in a fixed one, at rising times."""

    stamps: Float[np.ndarray, " pose"]  # seconds
    xyz: Float[np.ndarray, "pose 3"]  # metres
    quaternion: Float[np.ndarray, "pose 4"]  # x y z w


def rigid_transform(
    xyz: Float[np.ndarray, "*batch 3"], quaternion: Float[np.ndarray, "*batch 4"]
) -> Float[np.ndarray, "*batch 4 4"]:
    """Matrices of the poses `xyz` (metres) and `quaternion` (x y z w), on the host.

    Quaternions are normalised. Raises ValueError where one is zero or not finite.
    """
    xyz, quaternion = np.asarray(xyz, float), np.asarray(quaternion, float)
    length = np.linalg.norm(quaternion, axis=-1)
    if not (np.isfinite(length) & (length > 0)).all() or not np.isfinite(xyz).all():
        raise ValueError(
            f"xyz {xyz}, quaternion {quaternion}: expected finite numbers and a "
            "quaternion x y z w of some length"
        )
    matrix = np.zeros((*xyz.shape[:-1], 4, 4))
    flat = Rotation.from_quat(quaternion.reshape(-1, 4)).as_matrix()
    matrix[..., :3, :3] = flat.reshape(*xyz.shape[:-1], 3, 3)
    matrix[..., :3, 3] = xyz
    matrix[..., 3, 3] = 1
    return matrix


def transform(
    a_from_b: Float[np.ndarray, "4 4"], xyz: Float[np.ndarray, "point 3"]
) -> Float[np.ndarray, "point 3"]:
    """Points of frame b in frame a, on the host; keeps the points' precision."""
    moved = xyz @ a_from_b[:3, :3].T + a_from_b[:3, 3]
    return moved.astype(xyz.dtype)


def interpolate_poses(
    poses: Poses, stamps: Float[np.ndarray, " stamp"]
) -> Float[np.ndarray, "stamp 4 4"]:
    """Transforms at other times, on the host: straight lines and slerp between poses.

    NaN at times outside the trajectory. Raises ValueError where its times do not rise.
    """
    times, wanted = np.asarray(poses.stamps, float), np.asarray(stamps, float)
    if len(times) < 2 or not (np.diff(times) > 0).all():
        raise ValueError(
            f"a trajectory of {len(times)} poses, expected 2 or more at rising times"
        )
    inside = (wanted >= times[0]) & (wanted <= times[-1])
    result = np.full((len(wanted), 4, 4), np.nan)
    if inside.any():
        at = wanted[inside]
        turns = Slerp(times - times[0], Rotation.from_quat(poses.quaternion))
        xyz = [np.interp(at, times, column) for column in np.asarray(poses.xyz).T]
        result[inside] = rigid_transform(
            np.stack(xyz, -1), turns(at - times[0]).as_quat()
        )
    return result
