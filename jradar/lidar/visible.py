"""What the radar saw of a LiDAR scan: clusters of both clouds (V-A.3), on the host.

The clouds are clustered together (DBSCAN, Ester et al. 1996). LiDAR points of a cluster
that holds no radar point are removed, so that the network is not taught to invent
what the radar cannot see. The radar points should come from a detector at a useful
false-alarm rate: the condition's own threshold near zero has a point everywhere.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from jradar.lidar.align import returns


def visible_mask(
    lidar_xyz: Float[np.ndarray, "point 3"],
    radar_xyz: Float[np.ndarray, "echo 3"],
    *,
    eps_m: float = 0.5,
    min_points: int = 5,
    voxel_m: float = 0.1,
    max_points: int = 8000,
) -> Bool[np.ndarray, " point"]:
    """LiDAR points in a cluster with a radar point; both clouds in one frame.

    One LiDAR point per voxel is clustered and decides for the others; voxels grow
    until `max_points` are left, and `voxel_m = 0` takes all points. Points that DBSCAN
    calls noise stay if a radar point is within `eps_m`: the radar saw them too.
    """
    seen = np.zeros(len(lidar_xyz), bool)
    real = np.flatnonzero(returns(lidar_xyz))
    radar_xyz = radar_xyz[returns(radar_xyz)]
    if not len(real) or not len(radar_xyz):
        return seen
    chosen, voxel = voxel_filter(
        lidar_xyz[real], voxel_m=voxel_m, max_points=max_points
    )
    points = lidar_xyz[real][chosen]
    labels = dbscan(
        np.concatenate([points, radar_xyz]), eps_m=eps_m, min_points=min_points
    )
    of_lidar, of_radar = labels[: len(points)], labels[len(points) :]
    kept = (of_lidar >= 0) & np.isin(of_lidar, of_radar)
    noise = of_lidar < 0
    nearest, _ = cKDTree(radar_xyz).query(points[noise])
    kept[noise] = nearest <= eps_m
    seen[real] = kept[voxel]
    return seen


def voxel_filter(
    xyz: Float[np.ndarray, "point 3"], *, voxel_m: float, max_points: int
) -> tuple[Int[np.ndarray, " voxel"], Int[np.ndarray, " point"]]:
    """Index of the first point in each voxel, and each point's voxel; on the host.

    Voxels grow by a quarter until there are at most `max_points`; 0 metres is off.
    """
    if voxel_m <= 0 or not len(xyz):
        return np.arange(len(xyz)), np.arange(len(xyz))
    while True:
        _, first, voxel = np.unique(
            _grid_keys(xyz, voxel_m), return_index=True, return_inverse=True
        )
        if len(first) <= max(max_points, 1):
            return first, voxel
        voxel_m *= 1.25


def dbscan(
    xyz: Float[np.ndarray, "point 3"], *, eps_m: float, min_points: int
) -> Int[np.ndarray, " point"]:
    """Labels as scikit-learn's DBSCAN gives them: clusters from 0, noise -1; host.

    A point with `min_points` within `eps_m`, itself among them, is a core point. Core
    points of one cell as wide as eps / sqrt(3) are all neighbours, so that cells, not
    points, are joined: that takes half the time.
    """
    tree = cKDTree(xyz)
    pairs = tree.query_pairs(eps_m, output_type="ndarray")
    core = np.bincount(pairs.ravel(), minlength=len(xyz)) + 1 >= min_points
    labels = np.full(len(xyz), -1)
    if not core.any():
        return labels
    keys = _grid_keys(xyz[core], 0.999 * eps_m / np.sqrt(3))
    _, cell_of_core = np.unique(keys, return_inverse=True)
    count = cell_of_core.max() + 1
    cell = np.zeros(len(xyz), np.int64)
    cell[core] = cell_of_core
    first, second = pairs.T
    both = core[first] & core[second]
    edges = np.unique(cell[first[both]] * count + cell[second[both]])
    graph = csr_array(
        (np.ones(len(edges), bool), np.divmod(edges, count)), shape=(count, count)
    )
    _, component = connected_components(graph, directed=False)
    component = component[cell_of_core]
    # Clusters are numbered by their first core point ...
    _, first_core, component = np.unique(
        component, return_index=True, return_inverse=True
    )
    labels[core] = first_core.argsort().argsort()[component]
    # ... and a border point is of the first cluster that reaches it.
    border = np.full(len(xyz), len(xyz))
    for one, other in ((first, second), (second, first)):
        reached = core[one] & ~core[other]
        np.minimum.at(border, other[reached], labels[one[reached]])
    return np.where(border < len(xyz), border, labels)


def _grid_keys(xyz, size):
    """One integer for each cell of a cubic grid."""
    cell = np.floor(np.asarray(xyz, float) / size).astype(np.int64)
    cell -= cell.min(0)
    x, y, z = cell.T
    _, height, depth = cell.max(0) + 1
    return (x * height + y) * depth + z
