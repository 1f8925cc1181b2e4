"""One training step, as a pure function."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, Key

from jradar.diffusion import NoiseSpec, UNet, conditional_denoiser, denoising_loss
from jradar.training.state import TrainState

Metrics = dict[str, Float[Array, ""]]
Step = Callable[[TrainState, Key[Array, ""], "Batch"], tuple[TrainState, Metrics]]


class Batch(NamedTuple):
    """Conditions and the encoded images that should come out."""

    condition: Float[Array, "batch row column channel"]
    target: Float[Array, "batch target_row target_column 2"]


def make_train_step(
    network: UNet,
    optimizer: optax.GradientTransformation,
    noise: NoiseSpec,
    *,
    ema_decay: float = 0.999,
) -> Step:
    """The jitted step `(state, key, batch) -> (state, metrics)`.

    The step's randomness is `fold_in(key, state.step)`: a resumed run repeats the
    uninterrupted one. The moving average warms up, so that early averages are not made
    of initial weights.
    """

    @jax.jit
    def step(state, key, batch):
        key = jax.random.fold_in(key, state.step)

        def loss_of(params):
            denoise = conditional_denoiser(network, params, noise)(batch.condition)
            return denoising_loss(key, denoise, batch.target, noise=noise)

        loss, gradient = jax.value_and_grad(loss_of)(state.params)
        updates, opt_state = optimizer.update(gradient, state.opt_state, state.params)
        params = optax.apply_updates(state.params, updates)
        decay = jnp.minimum(ema_decay, (1 + state.step) / (10 + state.step))
        ema_params = optax.incremental_update(params, state.ema_params, 1 - decay)
        metrics = {"loss": loss, "gradient_norm": optax.tree.norm(gradient)}
        return TrainState(state.step + 1, params, ema_params, opt_state), metrics

    return step
