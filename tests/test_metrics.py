"""Metrics: brute force, host equals kernel, NaN for empty, invariances, gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.metrics import compare, compare_on_host, nearest_distances
from jradar.types import PointCloud


def random_cloud(seed, num, valid=0.8):
    keys = jax.random.split(jax.random.key(seed))
    xyz = jax.random.normal(keys[0], (num, 3))
    return PointCloud(xyz, jax.random.bernoulli(keys[1], valid, (num,)))


def valid_points(cloud):
    return np.asarray(cloud.xyz)[np.asarray(cloud.valid)]


@pytest.mark.parametrize("sizes", [(300, 200), (1, 5), (129, 128)])
def test_kernel_and_host_equal_brute_force(sizes):
    a, b = random_cloud(0, sizes[0], 1.0), random_cloud(1, sizes[1], 0.9)
    points = [valid_points(cloud).astype(np.float64) for cloud in (a, b)]
    table = np.linalg.norm(points[0][:, None] - points[1][None], axis=-1)
    forth, back = table.min(1), table.min(0)
    for scores in (compare(a, b), compare_on_host(*points)):
        np.testing.assert_allclose(
            scores.chamfer, forth.mean() + back.mean(), rtol=1e-5
        )
        worst = max(np.median(forth), np.median(back))
        np.testing.assert_allclose(scores.modified_hausdorff, worst, rtol=1e-5)
        for i, limit in enumerate((0.1, 0.2, 0.5)):
            p, r = (forth < limit).mean(), (back < limit).mean()
            f = 2 * p * r / (p + r) if p + r else 0.0
            np.testing.assert_allclose(scores.f_score[i], f, atol=1e-6)
            np.testing.assert_allclose(scores.precision[i], p, atol=1e-6)
            np.testing.assert_allclose(scores.recall[i], r, atol=1e-6)


def test_mean_of_both_halves_the_chamfer_distance():
    a, b = random_cloud(0, 50), random_cloud(1, 60)
    whole, half = compare(a, b), compare(a, b, mean_of_both=True)
    np.testing.assert_allclose(half.chamfer, whole.chamfer / 2, rtol=1e-6)


def test_padding_changes_nothing():
    a, b = random_cloud(0, 50, 1.0), random_cloud(1, 60, 1.0)
    padded = PointCloud(
        jnp.concatenate([a.xyz, jnp.zeros((9, 3))]), jnp.arange(59) < 50
    )
    for one, other in zip(compare(a, b), compare(padded, b), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6)


def test_identical_clouds_score_perfectly():
    a = random_cloud(0, 100)
    scores = compare(a, a)
    assert scores.chamfer == 0 and scores.modified_hausdorff == 0
    assert (scores.f_score == 1).all()


def test_known_shift_is_the_distance():
    a = PointCloud.from_xyz([[1.0, 0, 0], [2, 0, 0], [3, 0, 0]])
    b = PointCloud.from_xyz([[1.0, 0.15, 0], [2, 0.15, 0], [3, 0.15, 0]])
    scores = compare(a, b)
    assert scores.chamfer == pytest.approx(0.3)
    assert scores.modified_hausdorff == pytest.approx(0.15)
    assert scores.f_score.tolist() == [0, 1, 1]


def test_close_points_far_from_the_origin_keep_their_digits():
    a = PointCloud.from_xyz([[1000.0, 0, 0]])
    b = PointCloud.from_xyz([[1000.0, 0.0625, 0]])
    assert compare(a, b).chamfer == pytest.approx(0.125, rel=1e-6)


def test_empty_cloud_is_nan_everywhere():
    a, empty = random_cloud(0, 20), PointCloud.from_xyz(jnp.zeros((5, 3)))
    none = np.zeros((0, 3))
    for scores in (
        compare(a, empty),
        compare(empty, a),
        compare(empty, empty),
        compare_on_host(valid_points(a), none),
        compare_on_host(none, none),
    ):
        assert all(np.isnan(score).all() for score in scores)


def test_vmap_equals_the_loop():
    pairs = [(random_cloud(i, 40), random_cloud(i + 9, 30)) for i in range(3)]
    stacked = jax.tree.map(lambda *x: jnp.stack(x), *pairs)
    batch = jax.vmap(compare)(*stacked)
    for i, pair in enumerate(pairs):
        for one, many in zip(compare(*pair), batch, strict=True):
            np.testing.assert_allclose(one, many[i], rtol=1e-6)


def test_gradient_pulls_a_cloud_to_the_other_and_is_finite_on_it():
    a, b = random_cloud(0, 30, 1.0), random_cloud(1, 30, 1.0)

    def chamfer(xyz):
        return compare(PointCloud(xyz, a.valid), b).chamfer

    step = a.xyz - 0.1 * jax.grad(chamfer)(a.xyz)
    assert chamfer(step) < chamfer(a.xyz)
    assert jnp.isfinite(jax.grad(chamfer)(b.xyz)).all()


def test_distances_of_invalid_points_are_nan():
    a, b = random_cloud(0, 30, 0.5), random_cloud(1, 20, 0.5)
    forth, back = nearest_distances(a, b)
    np.testing.assert_array_equal(jnp.isnan(forth), ~a.valid)
    np.testing.assert_array_equal(jnp.isnan(back), ~b.valid)


def test_points_that_are_not_numbers_are_refused_on_the_host():
    with pytest.raises(ValueError, match="expected finite points"):
        compare_on_host(np.full((3, 3), np.nan), np.ones((3, 3)))
    with pytest.raises(ValueError, match=r"shape \(3, 4\)"):
        compare_on_host(np.ones((3, 4)), np.ones((3, 3)))
