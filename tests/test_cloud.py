"""A point cloud in one line."""

import jax
import jax.numpy as jnp
import numpy as np

from jradar.types import PointCloud

CLOUD = PointCloud.from_xyz(np.array([[1.0, -2, 0.5], [3, 4, 0], [0, 0, 0]]))


def test_a_cloud_prints_as_one_line():
    text = "2 of 3 points, x 1.00 to 3.00, y -2.00 to 4.00, z 0.00 to 0.50 m"
    assert str(CLOUD) == repr(CLOUD) == f"PointCloud({text})"
    measured = CLOUD._replace(valid=CLOUD.valid & False, velocity=jnp.ones(3))
    assert repr(measured) == "PointCloud(0 of 3 points, velocity)"
    both = jax.tree.map(lambda leaf: jnp.stack([leaf] * 2), CLOUD)
    assert "4 of 6 points in 2 clouds, x 1.00" in repr(both)


def test_a_cloud_without_values_prints_its_placeholders():
    assert "float32" in repr(jax.eval_shape(lambda: CLOUD))
    assert repr(PointCloud(0, None)) == "PointCloud(xyz=0)"
    seen = []
    jax.eval_shape(lambda cloud: seen.append(repr(cloud)), CLOUD)
    assert "Tracer" in seen[0] and "\n" not in seen[0]
