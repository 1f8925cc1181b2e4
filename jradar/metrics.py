"""Distances between two clouds: Chamfer, modified Hausdorff, F-score.

All three follow from one pass of nearest-neighbour distances, both ways, in metres.
`compare` takes masked clouds and works under `jit`, `vmap` and `grad`;
`compare_on_host` returns the same numbers from SciPy's tree, in float64. `f_score` is
one of them, and much faster to compute. A comparison with an empty cloud is NaN: count
and report such frames.
"""

from typing import TYPE_CHECKING, Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy  # loads `spatial` when it is first used
from jaxtyping import Array, Bool, Float

from jradar.compiled import jit
from jradar.nearest import squared_both_ways
from jradar.types import PointCloud, check_one_cloud

if TYPE_CHECKING:
    from scipy.spatial import KDTree

THRESHOLDS_M = (0.1, 0.2, 0.5)
NEAR_M = 0.2  # as in the confidence of `jradar.types.PointCloud`


class CloudMetrics(NamedTuple):
    """Scores of a predicted cloud against a true one; NaN where either is empty."""

    chamfer: Float[Array, "*batch"]  # m
    modified_hausdorff: Float[Array, "*batch"]  # m
    f_score: Float[Array, "*batch threshold"]  # 0 .. 1
    precision: Float[Array, "*batch threshold"]  # predicted points near a true one
    recall: Float[Array, "*batch threshold"]  # true points near a predicted one


@jit
def nearest_distances(
    a: PointCloud, b: PointCloud
) -> tuple[Float[Array, " point"], Float[Array, " other"]]:
    """Return the distance of each point to the other cloud, both ways, in metres.

    One pair of clouds; `vmap` it. NaN for invalid points and against an empty cloud.
    """
    for cloud in (a, b):
        check_one_cloud(cloud, "nearest_distances")
    forth, back = squared_both_ways(a.xyz, a.valid, b.xyz, b.valid)
    return _root_or_nan(forth), _root_or_nan(back)


@jit
def compare(prediction: PointCloud, truth: PointCloud) -> CloudMetrics:
    """Return the scores of one cloud against another; `vmap` it over pairs.

    Chamfer is the sum of the two mean distances, modified Hausdorff the larger of the
    two median distances. Precision, recall and F-score are at `THRESHOLDS_M`.
    """
    forth, back = nearest_distances(prediction, truth)
    return _scores(forth, back, jnp)


def compare_on_host(prediction: np.ndarray, truth: np.ndarray) -> CloudMetrics:
    """Return the scores of `compare` for valid points `[point, 3]`, in float64; host.

    Raises ValueError for another shape and for points that are not finite.
    """
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
            kd_tree(other).query(points, workers=-1)[0]
            for points, other in (clouds, reversed(clouds))
        )
    return _scores(forth, back, np)


def f_score(
    found: Float[np.ndarray, "point 3"],
    truth: Float[np.ndarray, "other 3"],
    *,
    within_m: float = 0.2,
) -> float:
    """Return the F-score of valid points at a distance, 0 if a cloud is empty; host."""
    if not len(found) or not len(truth):
        return 0.0
    precision, recall = (
        np.isfinite(
            kd_tree(other).query(points, distance_upper_bound=within_m)[0]
        ).mean()
        for points, other in ((found, truth), (truth, found))
    )
    return float(f_score_of(precision, recall))


def f_score_of(precision: Any, recall: Any) -> Any:
    """Return the F-score of precision and recall, 0 where both are 0.

    It is their harmonic mean, for numbers and for arrays of NumPy or JAX.
    """
    both = precision + recall
    return 2 * precision * recall / (both + (both == 0))


def near_truth(
    xyz: Float[np.ndarray, "point 3"],
    truth: Float[np.ndarray, "other 3"],
    *,
    within_m: float = NEAR_M,
) -> Bool[np.ndarray, " point"]:
    """Return which points have a true point at most that far away; host."""
    if not len(truth):
        return np.zeros(len(xyz), bool)
    # The bound of the search excludes points at the very distance.
    bound = np.nextafter(within_m, np.inf)
    tree = kd_tree(truth)
    nearest, _ = tree.query(xyz, distance_upper_bound=bound, workers=-1)
    return nearest <= within_m


def kd_tree(points: Float[np.ndarray, "point axis"]) -> "KDTree":
    """Return SciPy's tree of the points of a cloud; host.

    Distances are those of its default tree, found about three times as fast: clouds lie
    on surfaces, for which that splits at medians and shrinks boxes in vain.
    """
    return scipy.spatial.KDTree(points, balanced_tree=False, compact_nodes=False)


def _root_or_nan(squared):
    """Distances from their squares, NaN where infinite, with a finite gradient."""
    known = jnp.isfinite(squared)
    positive = known & (squared > 0)
    root = jnp.where(positive, jnp.sqrt(jnp.where(positive, squared, 1.0)), 0.0)
    return jnp.where(known, root, jnp.nan)


def _scores(forth: Any, back: Any, xp: Any) -> CloudMetrics:
    """Scores from the distances both ways; NaN is ignored."""
    no_rows = 0 in (forth.size, back.size)
    if no_rows or (xp is np and (np.isnan(forth).all() or np.isnan(back).all())):
        nan: Any = np.nan if xp is np else jnp.full((), jnp.nan)
        nothing: Any = xp.full(len(THRESHOLDS_M), xp.nan)
        return CloudMetrics(nan, nan, nothing, nothing, nothing)
    limits = xp.asarray(THRESHOLDS_M)[None]
    precision, recall = (
        xp.nanmean(
            xp.where(xp.isnan(distance)[:, None], np.nan, distance[:, None] < limits),
            axis=0,
        )
        for distance in (forth, back)
    )
    return CloudMetrics(
        xp.nanmean(forth) + xp.nanmean(back),
        xp.maximum(xp.nanmedian(forth), xp.nanmedian(back)),
        f_score_of(precision, recall),
        precision,
        recall,
    )
