"""Small networks with parameters that are not at their start, built once."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

from jradar.diffusion import UNet

SMALL = {"channels": 8, "multipliers": (1, 2), "blocks": 1, "attention_levels": (1,)}


@functools.cache
def build(image=(8, 32), condition=(8, 8), **changes):
    """Network, its first parameters, and arguments for two images."""
    rng = np.random.default_rng(0)
    network = UNet(**{**SMALL, **changes})
    args = (
        jnp.asarray(rng.normal(size=(2, *image, 2)), jnp.float32),
        jnp.array([-1.0, 0.5]),
        jnp.asarray(rng.normal(size=(2, *condition, 3)), jnp.float32),
    )
    return network, random_params(network, *args), args


def shapes_of(network, image, condition):
    """Shapes of the parameters; image and condition are `(row, column, channel)`."""
    args = (jnp.zeros((1, *image)), jnp.zeros(1), jnp.zeros((1, *condition)))
    return jax.eval_shape(network.init, jax.random.key(0), *args)


def random_params(network, *args):
    """Parameters of the network's shapes, none of them 0; nothing is compiled."""
    rng = np.random.default_rng(1)

    def fill(leaf):
        fan_in = np.prod(leaf.shape[:-1]) if leaf.ndim > 1 else 4
        return jnp.asarray(rng.normal(size=leaf.shape) / np.sqrt(fan_in), leaf.dtype)

    image, condition = args[0].shape[1:], args[2].shape[1:]
    return jax.tree.map(fill, shapes_of(network, image, condition))


@functools.partial(jax.jit, static_argnums=0)
def apply(network, params, *args):
    """The network's output."""
    return network.apply(params, *args)
