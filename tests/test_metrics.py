"""Metrics: brute force, host equals kernel, NaN for empty, invariances, gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar import nearest
from jradar.metrics import compare, compare_on_host, nearest_distances
from jradar.types import PointCloud

LARGE = 1100, 1300  # points; too many pairs to compare them all


def random_cloud(seed, num, valid=0.8):
    keys = jax.random.split(jax.random.key(seed))
    xyz = jax.random.normal(keys[0], (num, 3))
    return PointCloud(xyz, jax.random.bernoulli(keys[1], valid, (num,)))


def valid_points(cloud):
    return np.asarray(cloud.xyz)[np.asarray(cloud.valid)]


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
    return jnp.asarray(xyz, jnp.float32)


def brute_force(a, a_valid, b, b_valid):
    """Distances both ways in float64, NaN where a point is invalid."""
    table = np.zeros((len(a), len(b)))
    for axis in range(3):
        gap = np.float64(a)[:, None, axis] - np.float64(b)[None, :, axis]
        table += gap**2
    table = np.where(np.outer(a_valid, b_valid), np.sqrt(table), np.inf)
    forth, back = table.min(1), table.min(0)
    return [np.where(np.isfinite(d), d, np.nan) for d in (forth, back)]


@pytest.mark.parametrize("valid", [1.0, 0.7, 0.0])
@pytest.mark.parametrize(
    "kind",
    [
        "random",
        "clustered",
        "planar",
        "on a line",
        "duplicated",
        "one place",
        "an outlier",
    ],
)
def test_pruned_distances_of_large_clouds_equal_brute_force(kind, valid):
    assert LARGE[0] * LARGE[1] > nearest.MAX_PAIRS
    rng = np.random.default_rng(7)
    a, b = (cloud_of_kind(kind, i, num) for i, num in enumerate(LARGE))
    masks = [jnp.asarray(rng.random(num) < valid) for num in LARGE]
    # The values of padding must not matter.
    a = a.at[:3].set(jnp.where(masks[0][:3, None], a[:3], jnp.nan))
    distances = nearest_distances(PointCloud(a, masks[0]), PointCloud(b, masks[1]))
    expected = brute_force(np.nan_to_num(a), masks[0], b, masks[1])
    for one, other in zip(distances, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=0)


@pytest.mark.parametrize("sizes", [(1, 300), (129, 64)])
def test_pruned_search_of_any_size_equals_all_pairs(sizes):
    clouds = [random_cloud(i, num, 1.0) for i, num in enumerate(sizes)]
    a, b = clouds
    searches = (nearest._pruned_both_ways, nearest._all_pairs_both_ways)
    pruned, pairs = (jax.jit(s)(a.xyz, a.valid, b.xyz, b.valid) for s in searches)
    for one, other in zip(pruned, pairs, strict=True):
        np.testing.assert_allclose(one[0], other[0], rtol=1e-6)
        np.testing.assert_array_equal(one[1], other[1])


def test_points_that_are_not_numbers_count_as_invalid():
    a, b = random_cloud(0, 20, 1.0), random_cloud(1, 10, 1.0)
    broken = b._replace(xyz=b.xyz.at[3].set(jnp.nan))
    without = b._replace(valid=b.valid.at[3].set(False))
    for one, other in zip(
        nearest_distances(a, broken), nearest_distances(a, without), strict=True
    ):
        np.testing.assert_array_equal(one, other)


def test_distance_to_a_cloud_of_no_rows_is_nan():
    a, none = random_cloud(0, 20), PointCloud.from_xyz(jnp.zeros((0, 3)))
    forth, back = nearest_distances(a, none)
    assert jnp.isnan(forth).all() and back.shape == (0,)


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


@pytest.mark.usefixtures("as_a_user")
def test_batches_of_clouds_are_refused_with_the_mend():
    one = random_cloud(0, 20)
    batch = jax.tree.map(lambda column: jnp.stack([column, column]), one)
    for pair in ((batch, one), (one, batch), (batch, batch)):
        for function in (compare, nearest_distances):
            with pytest.raises(ValueError, match=r"\(2, 20, 3\).* use jax.vmap"):
                function(*pair)
    assert jax.vmap(compare)(batch, batch).chamfer.tolist() == [0, 0]


def test_comparison_with_an_array_of_no_points_is_nan():
    a, none = random_cloud(0, 20), PointCloud.from_xyz(jnp.zeros((0, 3)))
    for pair in ((a, none), (none, a), (none, none)):
        scores, shapes = compare(*pair), compare(a, a)
        for score, like in zip(scores, shapes, strict=True):
            assert jnp.isnan(score).all()
            assert (score.shape, score.dtype) == (like.shape, like.dtype)


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


@pytest.mark.parametrize(
    ("function", "sizes"), [(compare, (40, 30)), (nearest_distances, LARGE)]
)
def test_vmap_equals_the_loop(function, sizes):
    pairs = [[random_cloud(2 * i + j, sizes[j]) for j in (0, 1)] for i in range(3)]
    stacked = jax.tree.map(lambda *x: jnp.stack(x), *pairs)
    batch = jax.vmap(function)(*stacked)
    for i, pair in enumerate(pairs):
        for one, many in zip(function(*pair), batch, strict=True):
            np.testing.assert_allclose(one, many[i], rtol=1e-6)


@pytest.mark.parametrize("sizes", [(40, 30), LARGE])
def test_gradient_is_that_of_the_table_of_all_pairs(sizes):
    clouds = [random_cloud(i, num) for i, num in enumerate(sizes)]
    both_valid = clouds[0].valid[:, None] & clouds[1].valid

    def ours(a, b):
        distances = nearest_distances(
            *(c._replace(xyz=x) for c, x in zip(clouds, (a, b), strict=True))
        )
        return sum(jnp.nansum(jnp.sin(d)) for d in distances)

    def table(a, b):
        squared = sum((a[:, None, i] - b[None, :, i]) ** 2 for i in range(3))
        distance = jnp.sqrt(jnp.where(both_valid, squared, 1e6))
        return sum(
            jnp.where(distance.min(axis) < 1e3, jnp.sin(distance.min(axis)), 0).sum()
            for axis in (0, 1)
        )

    xyz = [cloud.xyz for cloud in clouds]
    gradients, expected = (
        jax.jit(jax.grad(f, argnums=(0, 1)))(*xyz) for f in (ours, table)
    )
    for one, other in zip(gradients, expected, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-5)


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
