"""One training step, as a pure function, and the moving average of its parameters."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, Int, Key

from jradar.diffusion import NoiseSpec, UNet, conditional_denoiser, denoising_loss
from jradar.training.state import TrainState

Metrics = dict[str, Float[Array, ""]]
Step = Callable[[TrainState, Key[Array, ""], "Batch"], tuple[TrainState, Metrics]]
Loss = Callable[..., Float[Array, ""]]


class Batch(NamedTuple):
    """Conditions and the encoded images that should come out."""

    condition: Float[Array, "batch row column channel"]
    target: Float[Array, "batch target_row target_column 2"]


def ema_decay_at(
    step: int | Int[Array, ""], *, decay: float = 0.999, gamma: float | None = None
) -> Float[Array, ""]:
    """Share of the old average that stays after the update of `step`, from 0 on.

    The decay warms up, so that early averages are not made of initial weights. With
    `gamma` the average follows a power function instead (Karras et al. 2024, Eq. 127):
    parameters of step t weigh as t^gamma, whatever the length of the run; 6.94 has a
    width of 10 % of the run, 16.97 one of 5 %.
    """
    count = jnp.asarray(step, jnp.float32) + 1
    if gamma is not None:
        return (1 - 1 / count) ** (gamma + 1)
    return jnp.minimum(decay, count / (count + 9))


def make_train_step(
    network: UNet,
    optimizer: optax.GradientTransformation,
    noise: NoiseSpec,
    *,
    loss: Loss = denoising_loss,
    ema_decay: float = 0.999,
    ema_gamma: float | None = None,
) -> Step:
    """The jitted step `(state, key, batch) -> (state, metrics)`.

    The step's randomness is `fold_in(key, state.step)`: a resumed run repeats the
    uninterrupted one. `loss` is `denoising_loss` or takes what that takes:
    `(key, denoise, clean, *, noise, step)`.
    """

    @jax.jit
    def step(state, key, batch):
        key = jax.random.fold_in(key, state.step)

        def loss_of(params):
            denoise = conditional_denoiser(network, params, noise)(batch.condition)
            return loss(key, denoise, batch.target, noise=noise, step=state.step)

        value, gradient = jax.value_and_grad(loss_of)(state.params)
        updates, opt_state = optimizer.update(gradient, state.opt_state, state.params)
        params = optax.apply_updates(state.params, updates)
        decay = ema_decay_at(state.step, decay=ema_decay, gamma=ema_gamma)
        ema_params = optax.incremental_update(params, state.ema_params, 1 - decay)
        metrics = {"loss": value, "gradient_norm": optax.tree.norm(gradient)}
        return TrainState(state.step + 1, params, ema_params, opt_state), metrics

    return step
