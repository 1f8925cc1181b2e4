"""The state of training, which a checkpoint holds."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Int, Key

from jradar.diffusion import Network


class TrainState(NamedTuple):
    """Parameters, their exponential moving average, and the optimiser's state."""

    step: Int[Array, ""]
    params: Any
    ema_params: Any
    opt_state: Any


def create_state(
    key: Key[Array, ""],
    network: Network,
    optimizer: optax.GradientTransformation,
    *,
    image_shape: tuple[int, int, int],
    condition_shape: tuple[int, int, int],
) -> TrainState:
    """Return the state before the first step.

    Shapes of images and conditions are [row, column, channel].
    """
    params = jax.jit(network.init)(
        key,
        jnp.zeros((1, *image_shape)),
        jnp.zeros(1),
        jnp.zeros((1, *condition_shape)),
    )
    return TrainState(jnp.zeros((), jnp.int32), params, params, optimizer.init(params))
