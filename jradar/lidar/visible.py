"""LiDAR points that the radar could have seen (V-A.3), on the host.

Both clouds are clustered together (DBSCAN, Ester et al. 1996). LiDAR points of a
cluster without a radar point are removed, so that the network does not learn to invent
what the radar cannot see. The radar points should come from a detector with a useful
false-alarm rate: the condition's threshold near zero yields points everywhere.
"""

import numpy as np
import scipy  # loads `spatial` when it is first used
from jaxtyping import Bool, Float, Int

from jradar.errors import optional
from jradar.lidar.align import returns


def visible_mask(
    lidar_xyz: Float[np.ndarray, "point 3"],
    radar_xyz: Float[np.ndarray, "echo 3"],
    *,
    eps_m: float = 0.5,
    min_points: int = 5,
    voxel_m: float = 0.15,
    max_points: int = 8000,
) -> Bool[np.ndarray, " point"]:
    """Return which LiDAR points share a cluster with a radar point; host.

    Both clouds are in one frame. One LiDAR point of each voxel is clustered, together
    with all radar points; the other points of the voxel follow it (see `voxel_filter`).
    A core point has at least `min_points` within `eps_m`, itself included. LiDAR points
    outside clusters are visible if a radar point lies within `eps_m`.
    """
    seen = np.zeros(len(lidar_xyz), bool)
    real = np.flatnonzero(returns(lidar_xyz))
    radar_xyz = radar_xyz[returns(radar_xyz)]
    if not len(real) or not len(radar_xyz):
        return seen
    first, voxel = voxel_filter(lidar_xyz[real], voxel_m=voxel_m, max_points=max_points)
    points = lidar_xyz[real][first]
    need = "clusters need scikit-learn"
    cluster = optional("sklearn.cluster", need=need, extra="data")
    # The ball tree is faster here than the k-d tree that "auto" would choose.
    method = cluster.DBSCAN(eps=eps_m, min_samples=min_points, algorithm="ball_tree")
    labels = method.fit_predict(np.concatenate([points, radar_xyz]))
    of_lidar, of_radar = np.split(labels, [len(points)])
    noise = of_lidar < 0
    kept = ~noise & np.isin(of_lidar, of_radar)
    nearest, _ = scipy.spatial.KDTree(radar_xyz).query(points[noise])
    kept[noise] = nearest <= eps_m
    seen[real] = kept[voxel]
    return seen


def voxel_filter(
    xyz: Float[np.ndarray, "point 3"], *, voxel_m: float, max_points: int
) -> tuple[Int[np.ndarray, " voxel"], Int[np.ndarray, " point"]]:
    """Return the index of the first point in each voxel, and the voxel of each point.

    Voxels grow by a quarter until there are at most `max_points`; `voxel_m = 0` keeps
    every point. Points must be finite. Host.
    """
    if not voxel_m or not len(xyz):
        return np.arange(len(xyz)), np.arange(len(xyz))
    while True:
        cell = np.floor(np.asarray(xyz, float) / voxel_m).astype(np.int64)
        cell -= cell.min(0)
        _, width, depth = cell.max(0) + 1
        x, y, z = cell.T
        _, first, voxel = np.unique(
            (x * width + y) * depth + z, return_index=True, return_inverse=True
        )
        if len(first) <= max(max_points, 1):
            return first, voxel
        voxel_m *= 1.25
