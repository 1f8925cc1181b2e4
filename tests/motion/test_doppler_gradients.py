"""Gradients of the ego velocity where some valid points tell nothing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.motion import ego_velocity
from tests.motion.test_doppler import KEY, cloud_of


@pytest.mark.parametrize("elevation", [True, False])
@pytest.mark.parametrize("value", [0.0, 1e-30, 1e-22, 1e30, np.inf, np.nan])
def test_points_without_a_direction_have_no_gradient(value, elevation):
    """At the origin, nearer than float32 resolves, and infinitely far away."""
    cloud, _ = cloud_of(3, np.array([1.3, -0.4, 0.0]), noise=0.02)
    xyz, velocity = map(jnp.asarray, (cloud.xyz, cloud.velocity))
    cloud = cloud._replace(xyz=xyz.at[:2].set(value), velocity=velocity)

    def forward(xyz, velocity):
        moved = cloud._replace(xyz=xyz, velocity=velocity)
        found = ego_velocity(KEY, moved, elevation=elevation)
        known = jnp.where(jnp.isfinite(found.covariance), found.covariance, 0.0)
        return found.velocity[0] + known.sum()

    slopes = jax.grad(forward, (0, 1))(cloud.xyz, cloud.velocity)
    for slope in slopes:
        assert np.isfinite(slope).all()
        assert not slope[:2].any() and np.abs(slope[2:]).max() > 1e-3
