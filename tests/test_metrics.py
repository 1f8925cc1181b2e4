"""Metrics: brute force, host equals kernel, NaN for empty, invariances, gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar import nearest
from jradar.metrics import (
    THRESHOLDS_M,
    compare,
    compare_on_host,
    f_score,
    nearest_distances,
)
from jradar.types import PointCloud

LARGE = 1100, 1300  # points; too many pairs to compare them all
KINDS = (
    *("random", "clustered", "planar", "on a line"),
    *("duplicated", "one place", "an outlier"),
)


def random_cloud(seed, num, valid=0.8):
    rng = np.random.default_rng(seed)
    xyz = rng.normal(size=(num, 3)).astype(np.float32)
    return PointCloud(xyz, rng.random(num) < valid)


A, B = random_cloud(0, 40), random_cloud(1, 30, 1.0)
EMPTY = PointCloud(B.xyz, np.zeros(30, bool))


def valid_points(cloud):
    return cloud.xyz[cloud.valid].astype(np.float64)


def cloud_of_kind(kind, seed, num):
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(-5, 5, (num, 3))
    if kind == "clustered":
        xyz = rng.integers(-2, 2, (num, 3)) * 20 + rng.normal(0, 0.05, (num, 3))
    elif kind == "planar":
        xyz[:, 2] = -1.5
    elif kind == "on a line":
        xyz[:, 1:] = 3.0
    elif kind == "duplicated":
        xyz = np.repeat(xyz[: num // 50 + 1], 50, axis=0)[:num]
    elif kind == "one place":
        xyz[:] = seed
    elif kind == "an outlier":
        xyz[0] = 1e6
    return xyz.astype(np.float32)


def brute_force(a, b):
    """Distances both ways in float64, NaN where a point is invalid."""
    places = [np.nan_to_num(cloud.xyz.astype(np.float64)) for cloud in (a, b)]
    gaps = places[0][:, None] - places[1]
    both = np.outer(a.valid, b.valid)
    table = np.where(both, np.sqrt((gaps**2).sum(-1)), np.inf)
    distances = table.min(1), table.min(0)
    return [np.where(np.isfinite(d), d, np.nan) for d in distances]


@pytest.mark.parametrize("valid", [1.0, 0.7, 0.0])
@pytest.mark.parametrize("kind", KINDS)
def test_pruned_distances_of_large_clouds_equal_brute_force(kind, valid):
    assert LARGE[0] * LARGE[1] > nearest.MAX_PAIRS
    rng = np.random.default_rng(7)
    clouds = (cloud_of_kind(kind, i, num) for i, num in enumerate(LARGE))
    a, b = (PointCloud(xyz, rng.random(len(xyz)) < valid) for xyz in clouds)
    a.xyz[~a.valid] = np.nan  # the values of padding must not matter
    found = nearest_distances(a, b)
    for one, other in zip(found, brute_force(a, b), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=0)


@pytest.mark.slow
@pytest.mark.parametrize("sizes", [(1, 300), (129, 64)])
def test_pruned_search_of_any_size_equals_all_pairs(sizes):
    a, b = (random_cloud(i, num, 1.0) for i, num in enumerate(sizes))
    searches = (nearest._pruned_both_ways, nearest._all_pairs_both_ways)
    pruned, pairs = (jax.jit(s)(a.xyz, a.valid, b.xyz, b.valid) for s in searches)
    for one, other in zip(pruned, pairs, strict=True):
        np.testing.assert_allclose(one[0], other[0], rtol=1e-6)
        np.testing.assert_array_equal(one[1], other[1])


def test_invalid_points_and_those_that_are_not_numbers_have_no_distance():
    broken = B.xyz.copy()
    broken[3] = np.nan
    without = B._replace(valid=np.arange(30) != 3)
    expected = brute_force(A, without)
    for cloud in (B._replace(xyz=broken), without):
        for one, other in zip(nearest_distances(A, cloud), expected, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-6)
    assert np.isnan(expected[0]).sum() == (~A.valid).sum() > 0


def scores_by_hand(forth, back):
    """Chamfer distance, modified Hausdorff, and the rest for each threshold."""
    yield forth.mean() + back.mean()
    yield max(np.median(forth), np.median(back))
    shares = [[(d < limit).mean() for limit in (0.1, 0.2, 0.5)] for d in (forth, back)]
    precision, recall = np.array(shares)
    yield 2 * precision * recall / np.maximum(precision + recall, 1e-9)
    yield precision
    yield recall


@pytest.mark.parametrize("sizes", [(40, 30), (1, 5), (129, 128)])
def test_kernel_and_host_equal_brute_force(sizes):
    a, b = random_cloud(0, sizes[0], 1.0), random_cloud(1, sizes[1], 0.9)
    found = [d[np.isfinite(d)] for d in brute_force(a, b)]
    for scores in (compare(a, b), compare_on_host(valid_points(a), valid_points(b))):
        for one, other in zip(scores, scores_by_hand(*found), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-6)


def test_the_quick_f_score_is_that_of_the_comparison():
    a, b = (valid_points(random_cloud(seed, 80, 1.0)) for seed in (0, 1))
    expected = dict(zip(THRESHOLDS_M, compare_on_host(a, b).f_score, strict=True))
    assert 0 < expected[0.2] < expected[0.5] < 1
    assert f_score(a, b) == pytest.approx(expected[0.2])
    assert f_score(a, b, within_m=0.5) == pytest.approx(expected[0.5])
    assert f_score(a, b[:0]) == f_score(a[:0], b) == 0
    assert f_score(np.zeros((1, 3)), np.array([[0, 0.25, 0]]), within_m=0.25) == 0


def test_identical_clouds_score_perfectly():
    scores = compare(A, A)
    assert scores.chamfer == 0 and scores.modified_hausdorff == 0
    assert np.all(scores.f_score == 1)


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


@pytest.mark.usefixtures("as_a_user")
def test_batches_of_clouds_are_refused_with_the_mend():
    batch = jax.tree.map(lambda column: np.stack([column, column]), A)
    for pair in ((batch, A), (A, batch), (batch, batch)):
        for function in (compare, nearest_distances):
            with pytest.raises(ValueError, match=r"\(2, 40, 3\).* use jax.vmap"):
                function(*pair)
    assert jax.vmap(compare)(batch, batch).chamfer.tolist() == [0, 0]


def test_comparison_with_an_empty_cloud_is_nan():
    none = PointCloud(np.zeros((0, 3), np.float32), np.zeros(0, bool))
    like = compare(A, B)
    for empty in (none, EMPTY):
        for pair in ((A, empty), (empty, B), (empty, empty)):
            for score, usual in zip(compare(*pair), like, strict=True):
                assert np.isnan(score).all()
                assert (score.shape, score.dtype) == (usual.shape, usual.dtype)
    forth, back = nearest_distances(A, none)
    assert np.isnan(forth).all() and back.shape == (0,)
    for points in (valid_points(A), np.zeros((0, 3))):
        scores = compare_on_host(points, np.zeros((0, 3)))
        assert all(np.isnan(score).all() for score in scores)


@pytest.mark.parametrize(
    ("function", "sizes"), [(compare, (40, 30)), (nearest_distances, LARGE)]
)
def test_vmap_equals_the_loop(function, sizes):
    pairs = [[random_cloud(2 * i + j, sizes[j]) for j in (0, 1)] for i in range(3)]
    batch = jax.vmap(function)(*jax.tree.map(lambda *x: np.stack(x), *pairs))
    for i, pair in enumerate(pairs):
        for one, many in zip(function(*pair), batch, strict=True):
            np.testing.assert_allclose(one, np.asarray(many)[i], rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("sizes", [(40, 30), LARGE])
def test_gradient_is_that_of_the_table_of_all_pairs(sizes):
    clouds = [random_cloud(i, num) for i, num in enumerate(sizes)]
    both_valid = np.outer(*(cloud.valid for cloud in clouds))

    def ours(*xyz):
        pair = (c._replace(xyz=x) for c, x in zip(clouds, xyz, strict=True))
        return sum(jnp.nansum(jnp.sin(d)) for d in nearest_distances(*pair))

    def table(a, b):
        squared = sum((a[:, None, i] - b[None, :, i]) ** 2 for i in range(3))
        distance = jnp.sqrt(jnp.where(both_valid, squared, 1e6))
        least = [distance.min(axis) for axis in (0, 1)]
        return sum(jnp.where(d < 1e3, jnp.sin(d), 0).sum() for d in least)

    xyz = [cloud.xyz for cloud in clouds]
    slopes = (jax.jit(jax.grad(f, argnums=(0, 1)))(*xyz) for f in (ours, table))
    for one, other in zip(*slopes, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-5)


def test_gradient_pulls_a_cloud_to_the_other_and_is_finite_on_it():
    a = random_cloud(2, 30, 1.0)

    @jax.jit
    @jax.value_and_grad
    def chamfer(xyz):
        return compare(a._replace(xyz=xyz), B).chamfer

    before, slope = chamfer(a.xyz)
    assert chamfer(a.xyz - 0.1 * slope)[0] < before
    assert np.isfinite(chamfer(B.xyz)[1]).all()


def test_points_that_are_not_numbers_are_refused_on_the_host():
    with pytest.raises(ValueError, match="expected finite points"):
        compare_on_host(np.full((3, 3), np.nan), np.ones((3, 3)))
    with pytest.raises(ValueError, match=r"shape \(3, 4\)"):
        compare_on_host(np.ones((3, 4)), np.ones((3, 3)))
