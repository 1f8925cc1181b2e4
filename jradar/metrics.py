"""How far two clouds are apart: Chamfer, modified Hausdorff, F-score.

All three come from one pass of nearest-neighbour distances, both ways, in metres. The
kernel on masked clouds works under `jit`, `vmap` and `grad`; `compare_on_host` gives
the same numbers from SciPy's tree, in float64. A comparison with an empty cloud is NaN:
count such frames, and say so.
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.spatial import KDTree

from jradar.nearest import squared_both_ways
from jradar.types import PointCloud

THRESHOLDS_M = (0.1, 0.2, 0.5)


class CloudMetrics(NamedTuple):
    """Scores of a predicted cloud against a true one; NaN where either is empty."""

    chamfer: Float[Array, "*batch"]  # m
    modified_hausdorff: Float[Array, "*batch"]  # m
    f_score: Float[Array, "*batch threshold"]  # 0 .. 1
    precision: Float[Array, "*batch threshold"]  # predicted points near a true one
    recall: Float[Array, "*batch threshold"]  # true points near a predicted one


@jax.jit
def nearest_distances(
    a: PointCloud, b: PointCloud
) -> tuple[Float[Array, " point"], Float[Array, " other"]]:
    """Distance of each point of `a` to `b`, and of each point of `b` to `a`, in metres.

    One pair of clouds; `vmap` it. NaN for invalid points and against an empty cloud.
    Differences are squared, never expanded, so close points keep their digits.
    """
    forth, back = squared_both_ways(a.xyz, a.valid, b.xyz, b.valid)
    return _root_or_nan(forth), _root_or_nan(back)


@functools.partial(jax.jit, static_argnames=("thresholds_m", "mean_of_both"))
def compare(
    prediction: PointCloud,
    truth: PointCloud,
    *,
    thresholds_m: tuple[float, ...] = THRESHOLDS_M,
    mean_of_both: bool = False,
) -> CloudMetrics:
    """Scores of one cloud against another; `vmap` it over pairs of clouds.

    Chamfer is the sum of the two mean distances, or with `mean_of_both` their mean;
    modified Hausdorff the larger of the two median distances.
    """
    forth, back = nearest_distances(prediction, truth)
    return _scores(forth, back, jnp, thresholds_m, mean_of_both)


def compare_on_host(
    prediction: np.ndarray,
    truth: np.ndarray,
    *,
    thresholds_m: tuple[float, ...] = THRESHOLDS_M,
    mean_of_both: bool = False,
) -> CloudMetrics:
    """`compare` for arrays of valid points `[point, 3]`, on the host in float64."""
    clouds = [np.asarray(points, np.float64) for points in (prediction, truth)]
    for points in clouds:
        if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
            raise ValueError(
                f"cloud of shape {points.shape}, expected finite points [point, 3]"
            )
    if any(len(points) == 0 for points in clouds):
        forth = back = np.full(1, np.nan)
    else:
        forth, back = (
            KDTree(other).query(points, workers=-1)[0]
            for points, other in (clouds, reversed(clouds))
        )
    return _scores(forth, back, np, thresholds_m, mean_of_both)


def _root_or_nan(squared):
    """Distances from their squares, infinite ones as NaN, with a finite gradient."""
    known = jnp.isfinite(squared)
    positive = known & (squared > 0)
    root = jnp.where(positive, jnp.sqrt(jnp.where(positive, squared, 1.0)), 0.0)
    return jnp.where(known, root, jnp.nan)


def _scores(
    forth: Any, back: Any, xp: Any, thresholds_m: tuple[float, ...], mean_of_both: bool
) -> CloudMetrics:
    """Scores from the distances both ways, NaN ones ignored."""
    empty = xp.isnan(forth).all() | xp.isnan(back).all()
    if xp is np and empty:
        nan: Any = np.nan
        nothing: Any = np.full(len(thresholds_m), np.nan)
        return CloudMetrics(nan, nan, nothing, nothing, nothing)
    limits = xp.asarray(thresholds_m)
    precision, recall = (
        xp.nanmean(
            xp.where(xp.isnan(distance)[:, None], np.nan, distance[:, None] < limits),
            axis=0,
        )
        for distance in (forth, back)
    )
    both = precision + recall
    return CloudMetrics(
        (xp.nanmean(forth) + xp.nanmean(back)) / (2 if mean_of_both else 1),
        xp.maximum(xp.nanmedian(forth), xp.nanmedian(back)),
        2 * precision * recall / xp.where(both > 0, both, 1.0),
        precision,
        recall,
    )
