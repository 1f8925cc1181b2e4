"""One training step, as a pure function, and the state that it changes."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, Int, Key

from jradar.compiled import jit
from jradar.diffusion import Network, NoiseSpec, conditional_denoiser, denoising_loss

Metrics = dict[str, Float[Array, ""]]
Loss = Callable[..., Float[Array, ""]]


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


class Batch(NamedTuple):
    """Conditions, and the encoded images that the network learns to draw."""

    condition: Float[Array, "batch row column channel"]
    target: Float[Array, "batch target_row target_column 2"]


Step = Callable[[TrainState, Key[Array, ""], Batch], tuple[TrainState, Metrics]]


def ema_decay_at(
    step: int | Int[Array, ""], *, decay: float = 0.999
) -> Float[Array, ""]:
    """Return the weight of the old average after a step; the first step is 0.

    The weight is small at first, so that the average soon forgets the initial
    parameters.
    """
    count = jnp.asarray(step, jnp.float32) + 1
    return jnp.minimum(decay, count / (count + 9))


def make_train_step(
    network: Network,
    optimizer: optax.GradientTransformation,
    noise: NoiseSpec,
    *,
    loss: Loss = denoising_loss,
    ema_decay: float = 0.999,
) -> Step:
    """Return the jitted step `(state, key, batch) -> (state, metrics)`.

    The step's randomness is `fold_in(key, state.step)`, so that a resumed run repeats
    the uninterrupted one. `loss` is called as `(key, denoise, clean, noise=noise)`.
    """

    @jit
    def step(state, key, batch):
        key = jax.random.fold_in(key, state.step)

        def loss_of(params):
            denoise = conditional_denoiser(network, params, noise)(batch.condition)
            return loss(key, denoise, batch.target, noise=noise)

        value, gradient = jax.value_and_grad(loss_of)(state.params)
        updates, opt_state = optimizer.update(gradient, state.opt_state, state.params)
        params = optax.apply_updates(state.params, updates)
        decay = ema_decay_at(state.step, decay=ema_decay)
        ema_params = optax.incremental_update(params, state.ema_params, 1 - decay)
        metrics = {"loss": value, "gradient_norm": optax.tree.norm(gradient)}
        return TrainState(state.step + 1, params, ema_params, opt_state), metrics

    return step
