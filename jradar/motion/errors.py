"""Errors of a trajectory against true poses, by the definitions of evo; host NumPy.

    APE   distances of positions, after the rigid motion that fits them best (Umeyama
          1991, without scale)
    RPE   translation and rotation of inv(inv(Q_i) Q_j) inv(P_i) P_j, for estimates P
          and true poses Q that follow one another

References: Sturm et al. 2012; github.com/MichaelGrupp/evo.
"""

from typing import NamedTuple

import numpy as np
import scipy  # loads `spatial` when it is first used
from jaxtyping import Float


class Errors(NamedTuple):
    """Statistics of errors, in one unit."""

    rmse: float
    mean: float
    median: float
    max: float


def umeyama(
    moved: Float[np.ndarray, "pose 3"], fixed: Float[np.ndarray, "pose 3"]
) -> Float[np.ndarray, "4 4"]:
    """Return the rigid motion of points `moved` that brings them closest to `fixed`."""
    centres = moved.mean(0), fixed.mean(0)
    left, _, right = np.linalg.svd((fixed - centres[1]).T @ (moved - centres[0]))
    mirror = np.diag([1, 1, np.sign(np.linalg.det(left) * np.linalg.det(right))])
    result = np.eye(4)
    result[:3, :3] = left @ mirror @ right
    result[:3, 3] = centres[1] - result[:3, :3] @ centres[0]
    return result


def position_errors(
    estimated: Float[np.ndarray, "pose 4 4"], true: Float[np.ndarray, "pose 4 4"]
) -> Errors:
    """Return the APE of positions in metres. Raises ValueError for fewer than 3."""
    _check(estimated, true, 3)
    moved, fixed = estimated[:, :3, 3], true[:, :3, 3]
    motion = umeyama(moved, fixed)
    moved = moved @ motion[:3, :3].T + motion[:3, 3]
    return _statistics(np.linalg.norm(moved - fixed, axis=1))


def step_errors(
    estimated: Float[np.ndarray, "pose 4 4"], true: Float[np.ndarray, "pose 4 4"]
) -> tuple[Errors, Errors]:
    """Return the RPE from pose to pose: in metres, and in degrees.

    Raises ValueError for fewer than 2 poses.
    """
    _check(estimated, true, 2)
    steps = [np.linalg.solve(poses[:-1], poses[1:]) for poses in (estimated, true)]
    error = np.linalg.solve(steps[1], steps[0])
    angle = np.degrees(
        scipy.spatial.transform.Rotation.from_matrix(error[:, :3, :3]).magnitude()
    )
    return _statistics(np.linalg.norm(error[:, :3, 3], axis=1)), _statistics(angle)


def _check(estimated, true, least):
    if len(estimated) != len(true) or len(true) < least:
        raise ValueError(
            f"{len(estimated)} estimated and {len(true)} true poses, expected as many "
            f"of both, and {least} or more"
        )


def _statistics(values):
    return Errors(
        rmse=float(np.sqrt(np.mean(values**2))),
        mean=float(values.mean()),
        median=float(np.median(values)),
        max=float(values.max()),
    )
