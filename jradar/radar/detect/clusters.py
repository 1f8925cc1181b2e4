"""From points to objects: peaks of the range-Doppler map, clusters of the cloud.

A target covers several cells of the map, each of which a detector marks. `map_peaks`
leaves one cell of each (`PointSpec.group_peaks`). An object with several reflectors is
still several points, which `cluster` joins by place and velocity, on the host.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jradar.compiled import jit
from jradar.errors import optional
from jradar.radar.peaks import local_maxima
from jradar.types import PointCloud


class Cluster(NamedTuple):
    """Points of one object."""

    centre: Float[np.ndarray, " 3"]  # metres, the mean weighted by power
    extent: Float[np.ndarray, " 3"]  # metres, from the first to the last point
    velocity: float  # m/s, the mean weighted by power; NaN if not measured
    power: float  # sum; the number of points if the cloud has none
    points: Int[np.ndarray, " member"]  # indices into the cloud


@jit
def map_peaks(
    power: Float[Array, "*batch doppler range"],
) -> Bool[Array, "*batch doppler range"]:
    """Return the cells that exceed their eight neighbours; of equal ones, one counts.

    The Doppler axis wraps around, the range axis ends.
    """
    padded = jnp.pad(power, [(0, 0)] * (power.ndim - 1) + [(1, 1)], constant_values=-1)
    return local_maxima(padded)[..., 1:-1]


def cluster(
    cloud: PointCloud,
    *,
    radius_m: float = 0.5,
    radius_mps: float = 0.5,
    min_points: int = 1,
) -> list[Cluster]:
    """Return clusters of a cloud's valid points (DBSCAN), strongest first; host.

    Two points are neighbours within an ellipsoid of `radius_m` in place and
    `radius_mps` in velocity. A point with fewer than `min_points` neighbours, itself
    included, does not start a cluster, and is left out unless a neighbour does. Raises
    ValueError for a radius of 0 or less and for batches.
    """
    if cloud.xyz.ndim != 2:
        raise ValueError(
            f"the cloud has shape {cloud.xyz.shape}, expected [point, 3]: pass one "
            "cloud at a time"
        )
    if min(radius_m, radius_mps) <= 0 or min_points < 1:
        raise ValueError(
            f"{radius_m=}, {radius_mps=}, {min_points=}, expected radii above 0 and 1 "
            "point or more"
        )
    clusters = optional(
        "sklearn.cluster", need="clusters need scikit-learn", extra="data"
    )
    index = np.flatnonzero(np.asarray(cloud.valid))
    if not len(index):
        return []
    xyz = np.asarray(cloud.xyz, np.float64)[index]
    weight, velocity = np.ones(len(index)), np.full(len(index), np.nan)
    features = xyz / radius_m
    if cloud.power is not None:
        weight = np.asarray(cloud.power, np.float64)[index]
    if cloud.velocity is not None:
        velocity = np.asarray(cloud.velocity, np.float64)[index]
        features = np.column_stack([features, velocity / radius_mps])
    labels = clusters.DBSCAN(eps=1.0, min_samples=min_points).fit_predict(features)
    found = []
    for label in range(labels.max() + 1):
        member = labels == label
        share = weight[member] / weight[member].sum()
        found.append(
            Cluster(
                centre=share @ xyz[member],
                extent=np.ptp(xyz[member], axis=0),
                velocity=float(share @ velocity[member]),
                power=float(weight[member].sum()),
                points=index[member],
            )
        )
    return sorted(found, key=lambda one: -one.power)
