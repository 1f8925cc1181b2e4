"""How fast are nearest neighbours both ways, compared with SciPy's tree?

The peers build a tree of each cloud, the usual one or that of `jradar.metrics.kd_tree`,
and query it with the other cloud. "cube" fills a volume, the hardest case for the
boxes; "room" lies on six walls with 2 cm of noise, like the points of a LiDAR. One
point in ten is invalid padding, which the peers do not get.
"""

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial import KDTree

from benchmarks.harness import Case
from jradar.metrics import compare, compare_on_host, kd_tree, nearest_distances
from jradar.types import PointCloud


def cases() -> Iterator[Case]:
    """Yield nearest neighbours by shape and size, and a gradient."""
    for shape in (cube, room):
        for num in (1000, 10_000, 65_536):
            yield nearest_case(shape, num)
    a, b = (random_cloud(room, seed, 10_000) for seed in (0, 1))
    points = valid_points(a), valid_points(b)

    @jax.jit
    @jax.grad
    def gradient(xyz, a, b):
        return compare(a._replace(xyz=xyz), b).chamfer

    yield Case(
        "gradient of the Chamfer distance 10,000 x 10,000 in a room",
        lambda: gradient(a.xyz, a, b),
        {"KDTree, no gradient": lambda: compare_on_host(*points)},
    )


def nearest_case(shape, num: int) -> Case:
    """Return the search for nearest neighbours in two clouds of one shape."""
    a, b = (random_cloud(shape, seed, num) for seed in (0, 1))
    p, q = valid_points(a), valid_points(b)
    return Case(
        f"nearest neighbours {num:,} x {num:,} in a {shape.__name__}",
        lambda: nearest_distances(a, b),
        {
            "KDTree": lambda: both_ways(KDTree, p, q),
            "KDTree, split at middles": lambda: both_ways(kd_tree, p, q),
        },
    )


def both_ways(tree, p: np.ndarray, q: np.ndarray):
    """Return the distances from each cloud to the other by trees of this kind."""
    return tree(q).query(p)[0], tree(p).query(q)[0]


def cube(rng, num):
    """Return points in a cube of 20 m."""
    return rng.uniform(-10, 10, (num, 3))


def room(rng, num):
    """Return points on the walls, floor and ceiling of a room, with 2 cm of noise."""
    size = np.array([10.0, 6.0, 2.0])
    xyz = rng.uniform(-1, 1, (num, 3)) * size
    axis, side = rng.integers(0, 3, num), rng.choice((-1, 1), num)
    xyz[np.arange(num), axis] = side * size[axis]
    return xyz + rng.normal(0, 0.02, (num, 3))


def random_cloud(shape, seed: int, num: int) -> PointCloud:
    """Return a cloud of a shape with one point in ten invalid."""
    rng = np.random.default_rng(seed)
    xyz = jnp.asarray(shape(rng, num), jnp.float32)
    return PointCloud(xyz, jnp.asarray(rng.random(num) < 0.9))


def valid_points(cloud: PointCloud) -> np.ndarray:
    """Return the valid points alone, on the host."""
    return np.asarray(cloud.xyz)[np.asarray(cloud.valid)]
