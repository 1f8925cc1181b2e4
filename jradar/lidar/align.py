"""Poses, rigid transforms and the shared field of view, on the host.

A transform `a_from_b` is a 4 x 4 matrix that takes points of frame b to frame a, so
that `a_from_c = a_from_b @ b_from_c`. Quaternions are x y z w. Drivers write a missing
return as (0, 0, 0), which must be removed before a cloud is moved: afterwards it looks
like a point.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy  # loads `spatial` when it is first used
from jaxtyping import Bool, Float


class Poses(NamedTuple):
    """A trajectory: the moving frame in a fixed one, at rising times."""

    stamps: Float[np.ndarray, " pose"]  # seconds
    xyz: Float[np.ndarray, "pose 3"]  # metres
    quaternion: Float[np.ndarray, "pose 4"]  # x y z w


def rigid_transform(
    xyz: Float[np.ndarray, "*batch 3"], quaternion: Float[np.ndarray, "*batch 4"]
) -> Float[np.ndarray, "*batch 4 4"]:
    """Return the matrices of poses: `xyz` in metres, `quaternion` as x y z w; host.

    Quaternions are normalised. Raises ValueError if one is zero or not finite.
    """
    xyz, quaternion = np.asarray(xyz, float), np.asarray(quaternion, float)
    length = np.linalg.norm(quaternion, axis=-1)
    if not (np.isfinite(length) & (length > 0)).all() or not np.isfinite(xyz).all():
        raise ValueError(
            f"xyz {xyz}, quaternion {quaternion}: expected finite numbers and a "
            "quaternion x y z w that is not zero"
        )
    x, y, z, w = np.moveaxis(quaternion / length[..., None], -1, 0)
    rows = [  # as SciPy's Rotation, which takes longer to load than to read a recording
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix = np.zeros((*xyz.shape[:-1], 4, 4))
    matrix[..., :3, :3] = np.moveaxis(np.array(rows), (0, 1), (-2, -1))
    matrix[..., :3, 3] = xyz
    matrix[..., 3, 3] = 1
    return matrix


def transform(
    a_from_b: Float[np.ndarray, "4 4"], xyz: Float[np.ndarray, "point 3"]
) -> Float[np.ndarray, "point 3"]:
    """Return points of frame b in frame a, on the host; keeps their precision."""
    # Column by column: BLAS would split so narrow a product over waiting threads.
    columns = [xyz @ row[:3] + row[3] for row in a_from_b[:3]]
    return np.stack(columns, -1).astype(xyz.dtype)


def interpolate_poses(
    poses: Poses, stamps: Float[np.ndarray, " stamp"]
) -> Float[np.ndarray, "stamp 4 4"]:
    """Return transforms at other times, by linear interpolation and slerp; host.

    Times outside the trajectory give NaN. Raises ValueError if its times do not rise.
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
        turn = scipy.spatial.transform.Rotation.from_quat(poses.quaternion)
        turns = scipy.spatial.transform.Slerp(times - times[0], turn)
        xyz = [np.interp(at, times, column) for column in np.asarray(poses.xyz).T]
        result[inside] = rigid_transform(
            np.stack(xyz, -1), turns(at - times[0]).as_quat()
        )
    return result


def returns(xyz: Float[np.ndarray, "point 3"]) -> Bool[np.ndarray, " point"]:
    """Return which points are echoes: finite, and not (0, 0, 0); on the host."""
    x, y, z = np.abs(xyz).T
    extent = x + y + z
    return (extent > 0) & (extent < np.inf)


def shared_field_of_view(
    xyz: Float[np.ndarray, "point 3"],
    *,
    azimuth: tuple[float, float],
    elevation: tuple[float, float],
    max_range_m: float,
    min_range_m: float = 0.3,
) -> Bool[np.ndarray, " point"]:
    """Return which points, in the radar's frame, lie in its field of view; host.

    Angles are (lowest, highest) in radians. Intervals are half open as in
    `range_image.pixel_of`. NaN and (0, 0, 0) are outside.
    """
    x, y, z = xyz.T
    ground = np.hypot(x, y)
    distance = np.hypot(ground, z)
    inside = (distance >= min_range_m) & (distance <= max_range_m) & (distance > 0)
    for sine, cosine, within in (
        (y, x, lambda angle: (angle >= azimuth[0]) & (angle < azimuth[1])),
        (z, ground, lambda angle: (angle > elevation[0]) & (angle <= elevation[1])),
    ):
        left = np.flatnonzero(inside)  # arctangents are the slow part
        inside[left] = within(np.arctan2(sine[left], cosine[left]))
    return inside


def accumulate(
    scans: Sequence[Float[np.ndarray, "_ column"]],
    transforms: Float[np.ndarray, "scan 4 4"],
) -> Float[np.ndarray, "point column"]:
    """Return several scans as one cloud, for LiDARs with sparse scans; on the host.

    `transforms[i]` takes scan i to the common frame. Columns after x, y and z, such as
    intensity, stay with their points. Missing returns are dropped, and so are scans
    whose transform is NaN (see `interpolate_poses`).
    """
    if len(scans) != len(transforms):
        raise ValueError(
            f"{len(scans)} scans and {len(transforms)} transforms, expected as many"
        )
    moved = [
        np.column_stack([transform(matrix, scan[:, :3]), scan[:, 3:]])[
            returns(scan[:, :3])
        ]
        for scan, matrix in zip(scans, transforms, strict=True)
        if np.isfinite(matrix).all()
    ]
    if not moved:
        return np.zeros((0, scans[0].shape[1] if len(scans) else 3), np.float32)
    return np.concatenate(moved)
