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
    return network, jax.jit(network.init)(jax.random.key(2, impl="rbg"), *args), args


def shaken(params):
    """Parameters with noise added, so that no layer is zero."""
    rng = np.random.default_rng(1)
    return jax.tree.map(
        lambda p: p + jnp.asarray(0.1 * rng.normal(size=p.shape), p.dtype), params
    )


@functools.partial(jax.jit, static_argnums=0)
def apply(network, params, *args):
    """The network's output."""
    return network.apply(params, *args)
