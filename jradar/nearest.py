"""Nearest neighbours between two masked clouds, both ways: exact, fast, differentiable.

On a CPU each cloud is sorted along a Z-order curve and cut into blocks of close points,
each with a bounding box. A block of queries visits the blocks of the other cloud,
nearest box first, until the next box is farther than every neighbour found so far:

    +---------+     +-----+  +-----+     +-----+
    | queries | <-- |  1  |  |  2  | ... |  k  |   stop: no point in here is nearer
    +---------+     +-----+  +-----+     +-----+

Small clouds, and all clouds on other devices, are compared by all pairs. Distances are
sums of squared differences, never expanded, so close points keep their precision.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

QUERY_BLOCK, TARGET_BLOCK = 128, 64  # points; the second a power of 2
# Up to this size all pairs are as fast, and compile much faster.
MAX_PAIRS = 1 << 20


@jax.custom_jvp
def squared_both_ways(
    a: Float[Array, "point 3"],
    a_valid: Bool[Array, " point"],
    b: Float[Array, "other 3"],
    b_valid: Bool[Array, " other"],
) -> tuple[Float[Array, " point"], Float[Array, " other"]]:
    """Return the squared distances from `a` to `b` and from `b` to `a`.

    One pair of clouds; `vmap` it. Distances of points that are invalid or not finite,
    and distances to an empty cloud, are infinite.
    """
    (forth, _), (back, _) = _nearest_both_ways(a, a_valid, b, b_valid)
    return forth, back


@squared_both_ways.defjvp
def _squared_both_ways_jvp(primals, tangents):
    """Derivative through the nearest points only: the search has no derivative."""
    (a, _, b, _), (a_moves, _, b_moves, _) = primals, tangents
    (forth, nearest_b), (back, nearest_a) = _nearest_both_ways(*primals)

    def change(squared, xyz, other, moves, other_moves):
        apart = jnp.where(jnp.isfinite(squared)[:, None], xyz - other, 0.0)
        return 2 * (apart * (moves - other_moves)).sum(-1)

    change_forth = change(forth, a, b[nearest_b], a_moves, b_moves[nearest_b])
    change_back = change(back, b, a[nearest_a], b_moves, a_moves[nearest_a])
    return (forth, back), (change_forth, change_back)


def _nearest_both_ways(a, a_valid, b, b_valid):
    """(squared distance, index) of the nearest point in the other cloud, both ways."""
    if 0 in (len(a), len(b)):
        return tuple(
            (jnp.full(len(xyz), jnp.inf, xyz.dtype), jnp.zeros(len(xyz), jnp.int32))
            for xyz in (a, b)
        )
    a_valid &= jnp.isfinite(a).all(-1)
    b_valid &= jnp.isfinite(b).all(-1)
    if len(a) * len(b) <= MAX_PAIRS:
        return _all_pairs_both_ways(a, a_valid, b, b_valid)
    return jax.lax.platform_dependent(
        a, a_valid, b, b_valid, cpu=_pruned_both_ways, default=_all_pairs_both_ways
    )


def _all_pairs_both_ways(a, a_valid, b, b_valid):
    """`_nearest_both_ways` by brute force, one block of queries after another."""

    def one_way(xyz, valid, others, others_valid):
        def nearest(point):
            squared = _squared_distance(point, others.T)
            squared = jnp.where(others_valid, squared, jnp.inf)
            return squared.min(), squared.argmin().astype(jnp.int32)

        squared, index = jax.lax.map(nearest, xyz, batch_size=QUERY_BLOCK)
        return jnp.where(valid, squared, jnp.inf), index

    return one_way(a, a_valid, b, b_valid), one_way(b, b_valid, a, a_valid)


@jax.custom_batching.sequential_vmap
def _pruned_both_ways(a, a_valid, b, b_valid):
    """`_nearest_both_ways` by sorted blocks; the clouds of a batch run one by one."""
    orders = _z_order(a, a_valid), _z_order(b, b_valid)
    sorted_points = [
        jnp.where(valid[order, None], xyz[order], jnp.inf)
        for xyz, valid, order in ((a, a_valid, orders[0]), (b, b_valid, orders[1]))
    ]

    def one_way(points, order, others, others_order):
        squared, position = _pruned_search(points, others)
        squared = jnp.where(jnp.isfinite(points[:, 0]), squared, jnp.inf)
        # Back to the clouds' own order.
        index = others_order[position]
        return (
            jnp.zeros_like(squared).at[order].set(squared),
            jnp.zeros_like(index).at[order].set(index),
        )

    forth = one_way(sorted_points[0], orders[0], sorted_points[1], orders[1])
    return forth, one_way(sorted_points[1], orders[1], sorted_points[0], orders[0])


def _pruned_search(points, others):
    """Squared distance and position of the nearest point in `others`."""
    queries, query_boxes = _blocks(points, QUERY_BLOCK)
    targets, target_boxes = _blocks(others, TARGET_BLOCK)

    def search_block(block):
        query, low, high = block
        real = jnp.isfinite(query[0])
        visits, bounds = _nearest_boxes(low, high, *target_boxes)

        def may_improve(state):
            step, _, _, worst = state
            return (step < len(targets)) & (bounds[step] < worst)

        def visit(state):
            step, best, owner, _ = state
            target = targets[visits[step]]
            nearest = _tree_min(
                [_squared_distance(query, target[:, i]) for i in range(TARGET_BLOCK)]
            )
            owner = jnp.where(nearest < best, visits[step], owner)
            best = jnp.minimum(nearest, best)
            return step + 1, best, owner, jnp.where(real, best, -jnp.inf).max()

        best = jnp.full(QUERY_BLOCK, jnp.inf, query.dtype)
        state = 0, best, jnp.zeros(QUERY_BLOCK, jnp.int32), best[0]
        return jax.lax.while_loop(may_improve, visit, state)[1:3]

    def position_in(block):
        query, owner = block
        near = targets[owner]  # [query, 3, target]
        best, place = jnp.full(QUERY_BLOCK, jnp.inf, query.dtype), jnp.zeros_like(owner)
        for i in range(TARGET_BLOCK):  # faster than an argmin on a CPU
            squared = _squared_distance(query, near[:, :, i].T)
            nearer = squared < best
            best, place = jnp.where(nearer, squared, best), jnp.where(nearer, i, place)
        return owner * TARGET_BLOCK + place

    best, owner = jax.lax.map(search_block, (queries, *query_boxes))
    position = jax.lax.map(position_in, (queries, owner))
    return best.reshape(-1)[: len(points)], position.reshape(-1)[: len(points)]


def _nearest_boxes(low, high, target_low, target_high):
    """Numbers of the boxes, nearest first, and lower bounds of squared distances."""
    low, high = low[None], high[None]
    gap = jnp.maximum(jnp.maximum(target_low - high, low - target_high), 0.0)
    # Reduced by a few roundings, so that no bound exceeds a distance to its points.
    bound = ((gap**2).sum(-1) * (1 - 1e-6)).astype(jnp.float32)
    # Both are sorted as one integer, which is faster than sorting pairs.
    number = jnp.arange(len(bound), dtype=jnp.uint32)
    mask = jnp.uint32((1 << _bits(len(bound))) - 1)
    key = jax.lax.bitcast_convert_type(bound, jnp.uint32) & ~mask
    key = jnp.sort(key | number, stable=False)
    bounds = jax.lax.bitcast_convert_type(key & ~mask, jnp.float32)
    return (key & mask).astype(jnp.int32), bounds


def _blocks(points, size):
    """Points `[block, 3, point]`, padded with inf, and their boxes `[block, 3]`."""
    points = jnp.pad(
        points, ((0, -len(points) % size), (0, 0)), constant_values=jnp.inf
    )
    blocks = jnp.moveaxis(points.reshape(-1, size, 3), 2, 1)
    real = jnp.isfinite(blocks)
    return blocks, (blocks.min(-1), jnp.where(real, blocks, -jnp.inf).max(-1))


def _z_order(xyz, valid):
    """Order of points along a Morton curve of 1024^3 cells, by a radix sort in two."""
    low = jnp.where(valid[:, None], xyz, jnp.inf).min(0)
    size = (jnp.where(valid[:, None], xyz, -jnp.inf).max(0) - low).max()
    unit = (xyz - low[None]) / jnp.where(size > 0, size, 1.0)
    x, y, z = _spread((unit.T * 1023).clip(0, 1023).astype(jnp.uint32))
    code = jnp.where(valid, x << 2 | y << 1 | z, (1 << 30) - 1)
    bits = _bits(len(xyz))
    digit = 32 - bits
    code = code >> max(30 - 2 * digit, 0)
    number = jnp.arange(len(xyz), dtype=jnp.uint32)
    order = number
    for part in (code & jnp.uint32((1 << digit) - 1), code >> digit):
        key = jnp.sort(part[order] << bits | number, stable=False)
        order = order[key & jnp.uint32((1 << bits) - 1)]
    return order.astype(jnp.int32)


def _spread(cell):
    """Spread ten bits over every third bit of thirty."""
    for shift, mask in (
        (16, 0x30000FF),
        (8, 0x300F00F),
        (4, 0x30C30C3),
        (2, 0x9249249),
    ):
        cell = (cell | cell << shift) & jnp.uint32(mask)
    return cell


def _bits(count):
    """Number of bits for the numbers below `count`, at least one."""
    return max(1, (count - 1).bit_length())


def _squared_distance(xyz, other):
    """Squared distance of points; the leading axis is x, y, z."""
    x, y, z = (xyz[axis] - other[axis] for axis in range(3))
    return x * x + y * y + z * z


def _tree_min(values):
    """Elementwise minimum by pairs of pairs: faster than a chain on a CPU."""
    while len(values) > 1:
        values = [
            jnp.minimum(*pair) for pair in zip(values[::2], values[1::2], strict=True)
        ]
    return values[0]
