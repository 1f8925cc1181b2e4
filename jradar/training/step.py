"""One training step, as a pure function, and the state that it changes."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, Int, Key

from jradar.compiled import jit
from jradar.data import Batch
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
    return state_of(params, optimizer)


def state_of(params: Any, optimizer: optax.GradientTransformation) -> TrainState:
    """Return the state before the first step that starts from these parameters."""
    moments = jax.jit(optimizer.init)(params)
    return TrainState(jnp.zeros((), jnp.int32), params, params, moments)


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

    def loss_of(params, key, batch):
        denoise = conditional_denoiser(network, params, noise)(batch.condition)
        return loss(key, denoise, batch.target, noise=noise), {}

    return make_step(loss_of, optimizer, ema_decay=ema_decay)


def make_step(
    loss_of: Callable[..., tuple[Float[Array, ""], Metrics]],
    optimizer: optax.GradientTransformation,
    *,
    ema_decay: float,
) -> Step:
    """Return the step of `make_train_step` for any loss.

    `loss_of(params, key, batch)` returns the loss, and its parts as further metrics.
    """

    @jit
    def step(state, key, batch):
        key = jax.random.fold_in(key, state.step)
        (value, parts), gradient = jax.value_and_grad(loss_of, has_aux=True)(
            state.params, key, batch
        )
        updates, opt_state = optimizer.update(gradient, state.opt_state, state.params)
        params = optax.apply_updates(state.params, updates)
        decay = ema_decay_at(state.step, decay=ema_decay)
        ema_params = optax.incremental_update(params, state.ema_params, 1 - decay)
        norm = optax.tree.norm(gradient)
        metrics = {"loss": value, "gradient_norm": norm, **parts}
        return TrainState(state.step + 1, params, ema_params, opt_state), metrics

    return step
