"""RPDNet: its input's scale, where its levels end, what its logits depend on."""

import jax
import jax.numpy as jnp
import numpy as np

from experiments.rpdnet.network import RPDNet, map_values


def test_map_values_span_the_unit_interval():
    power = 10.0 ** np.linspace(-2, 3, 12).reshape(3, 4)
    expected = np.linspace(0, 1, 12).reshape(3, 4)
    np.testing.assert_allclose(map_values(power), expected, atol=1e-6)
    assert (map_values(np.ones((2, 2))) == 0).all()
    spike = np.zeros((2, 2))
    spike[0, 0] = 1.0
    np.testing.assert_allclose(map_values(spike), spike)


def test_levels_end_where_an_axis_has_one_cell():
    maps = jnp.zeros((1, 12, 8, 1))
    shapes = jax.eval_shape(RPDNet(channels=4).init, jax.random.key(0), maps)["params"]
    assert sum(name.startswith("join") for name in shapes) == 4  # 12, 6, 3 and 2 rows


def test_an_odd_map_has_the_levels_of_the_next_power_of_two():
    network, maps = RPDNet(channels=4), jnp.ones((1, 8, 8, 1))
    odd, even = (
        jax.eval_shape(network.init, jax.random.key(0), maps[:, :rows])
        for rows in (7, 8)
    )
    assert jax.tree.map(jnp.shape, odd) == jax.tree.map(jnp.shape, even)
    params = jax.jit(network.init)(jax.random.key(0), maps)
    assert jax.jit(network.apply)(params, maps[:, :7]).shape == (1, 7, 8, 1)


def test_each_map_has_logits_of_its_own():
    network = RPDNet(channels=4, levels=2)
    maps = jax.random.uniform(jax.random.key(0), (2, 4, 6, 1))
    init = jax.eval_shape(network.init, jax.random.key(1), maps)
    rng = np.random.default_rng(0)
    params = jax.tree.map(
        lambda leaf: jnp.asarray(rng.normal(size=leaf.shape), leaf.dtype), init
    )
    both = jax.jit(network.apply)(params, maps)
    assert both.shape == maps.shape and np.isfinite(both).all()
    changed = jax.jit(network.apply)(params, maps.at[1].set(0.5))
    np.testing.assert_array_equal(both[0], changed[0])
    assert abs(both[1] - changed[1]).max() > 1e-3
