"""Small frames with known contents."""

import jax.numpy as jnp
import numpy as np

from jradar.lidar import rigid_transform
from jradar.outputs.published import Published, lidar_cloud
from jradar.types import PointCloud

BASE_FROM = {
    "radar": rigid_transform(np.array([0.1, 0.2, 0.3]), np.array([0, 0, 0.6, 0.8])),
    "lidar": rigid_transform(np.array([0.0, 0, 1]), np.array([0, 0, 0, 1.0])),
}


def cloud_of(points, seed=0):
    """A cloud with velocity and power, of which half the points are valid."""
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(2 * points, 5)).astype(np.float32)
    valid = np.arange(2 * points) % 2 == 0
    return PointCloud(
        jnp.asarray(values[:, :3]),
        jnp.asarray(valid),
        velocity=jnp.asarray(values[:, 3]),
        power=jnp.asarray(values[:, 4]),
    )


def frame_of(number, points=50):
    """A frame with everything that can be in one."""
    rng = np.random.default_rng(number)
    return Published(
        number,
        1_700_000_000.25 + 0.1 * number,
        {
            "radar": cloud_of(points, seed=number),
            "lidar": lidar_cloud(rng.normal(size=(7, 3)).astype(np.float32)),
        },
        rng.integers(0, 256, (6, 4), np.uint8),
        BASE_FROM,
    )


def columns_of(cloud):
    """x, y, z, velocity and power of the valid points, by name."""
    valid = np.asarray(cloud.valid)
    found = dict(zip("xyz", np.asarray(cloud.xyz)[valid].T, strict=True))
    for name in ("velocity", "power"):
        if getattr(cloud, name) is not None:
            found[name] = np.asarray(getattr(cloud, name))[valid]
    return found
