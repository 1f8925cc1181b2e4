"""What the radar's points add to a cloud in its plane."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.model import PolarGrid
from jradar.model.grids.polar import MAX_RANGE_M
from jradar.types import PointCloud

surroundings = jax.jit(PolarGrid().surroundings)


def test_what_is_around_a_point_lies_across_the_line_of_sight():
    xyz = np.array([[6.0, 0.0, 0.2], [3.0, -3.0, 0.0]])
    found = surroundings(PointCloud.from_xyz(xyz))
    assert found.valid.all() and found.velocity is None
    for centre, around in zip(
        xyz, np.asarray(found.xyz).reshape(2, 10, 3), strict=True
    ):
        assert not around[:, 2].any()
        flat = centre * (1, 1, 0)
        ahead = flat / np.linalg.norm(flat)
        steps = around - flat
        np.testing.assert_allclose(np.abs(steps @ ahead), 0.05, atol=1e-5)
        aside = np.sort(np.cross(ahead, steps)[:, 2])
        np.testing.assert_allclose(aside, -aside[::-1], atol=1e-5)
        # Half of a Gaussian of deviation 0.15 m lies within 0.1 m.
        assert np.median(np.abs(aside)) == pytest.approx(0.101, abs=0.005)


def test_points_above_behind_or_out_of_reach_add_nothing():
    beyond = MAX_RANGE_M + 0.1
    xyz = [(4, 1, 0.5), (-4, 1, 0), (beyond * 0.8, beyond * 0.6, 0), (4, 1, 0)]
    points = PointCloud(jnp.asarray(xyz, float), jnp.asarray([True] * 3 + [False]))
    found = surroundings(points)
    assert not found.valid.any() and not found.confidence.any()
    edge = surroundings(PointCloud.from_xyz([(0.05, 5, 0), (9.98, 0, 0)]))
    valid = np.asarray(edge.valid)
    assert 0 < valid.sum() < 20
    x, y, _ = np.asarray(edge.xyz)[valid].T
    assert x.min() > 0 and x.max() <= 10 and np.abs(y).max() <= 10


def test_confidence_grows_with_the_points_near():
    crowd = [(5, 0.001 * k, 0) for k in range(32)]
    found = surroundings(PointCloud.from_xyz([*crowd, (5, 5, 0), (5, 0, 2)]))
    said = np.asarray(found.confidence).reshape(34, 10)
    np.testing.assert_allclose(said[:32], 0.5, atol=1e-6)  # 1,024 make 1
    assert not said[32:].any()


def test_gradients_around_padding_are_finite():
    padded = PointCloud(jnp.zeros((3, 3)).at[0, 0].set(4.0), jnp.arange(3) < 1)

    def total(points):
        return surroundings(points).xyz.sum()

    slope = jax.grad(total, allow_int=True)(padded)
    assert np.isfinite(slope.xyz).all() and np.asarray(slope.xyz)[0].any()
