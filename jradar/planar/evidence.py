"""What the radar's own points add to a cloud in the plane.

A network of polar images sees the strongest cells of one chirp. The detector has all
chirps of a frame, and finds much that such an image does not show. So each of its
points is in the cloud as ten points across the line of sight. How sure they are depends
on how many others are near, as in `jradar.range_image.evidence`. What the network draws
away from all of them must be surer to be kept.
"""

import jax
import jax.numpy as jnp
import numpy as np
import scipy  # loads `special` when it is first used
from jaxtyping import Array, Bool, Float

from jradar.planar.grid import MAX_RANGE_M, in_view
from jradar.planar.truth import HALF_HEIGHT_M
from jradar.range_image import ImageSpec, count_near, crowding
from jradar.types import PointCloud

AROUND = 10  # points for each point of the radar
WIDE_M = 0.15  # their deviation to the sides
DEEP_M = 0.05  # and along the line of sight
VIEW = ImageSpec(1, 1, max_range_m=MAX_RANGE_M)  # near is a share of the range


@jax.jit
def plane_surroundings(points: PointCloud) -> PointCloud:
    """Return ten points around each point of the radar that lies in its plane.

    Points of the plane are at most 0.3 m above or below the radar. Their confidence is
    their `crowding`. The points around them have height 0, and are valid if both are in
    view. One cloud; `vmap` it.
    """
    xyz = jnp.where(points.valid[:, None], points.xyz, jnp.asarray((1.0, 0.0, 0.0)))
    level = points.valid & (abs(xyz[:, 2]) <= HALF_HEIGHT_M) & in_view(xyz)
    flat = PointCloud(xyz * jnp.asarray((1.0, 1.0, 0.0)), level)
    ahead = flat.xyz / jnp.linalg.norm(flat.xyz, axis=-1, keepdims=True)
    left = jnp.stack([-ahead[:, 1], ahead[:, 0], ahead[:, 2]], -1)
    axes = jnp.stack([ahead, left], 1)
    around = flat.xyz[:, None] + jnp.asarray(_steps(), xyz.dtype) @ axes
    valid = level[:, None] & in_view(around)
    confidence = jnp.where(valid, crowding(flat, VIEW, axes=2)[:, None], 0.0)
    return PointCloud(
        around.reshape(-1, 3), valid.ravel(), confidence=confidence.ravel()
    )


@jax.jit
def near_points(
    xyz: Float[Array, "*batch 3"], points: PointCloud
) -> Bool[Array, "*batch"]:
    """Return which places have one of the points within about 0.5 m in the plane."""
    return count_near(xyz[..., :2], points.xyz[:, :2], points.valid, VIEW) > 0


def _steps():
    """Steps [point, 2] ahead and to the left: a Gaussian, evenly sampled."""
    wide = WIDE_M * scipy.special.ndtri((np.arange(AROUND) + 0.5) / AROUND)
    deep = DEEP_M * np.where(np.arange(AROUND) % 2, 1, -1)
    return np.stack([deep, wide], -1)
