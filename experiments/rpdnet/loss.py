"""RPDNet's training: focal loss, and a critic that separates masks from labels.

Cheng, Su, Jiang & Liu, "A Novel Radar Point Cloud Generation Method for Robot
Environment Perception", IEEE Transactions on Robotics 2022. The critic, a stack of
strided convolutions, sees the map where a mask is set: once with the network's mask,
once with the label. It learns to separate the two by the distance of its features.

The public code differs in these points. There, the critic's weights are clipped; here,
its normalisation has no scale, which bounds its features. There, the critic takes five
steps for each of the detector's; here, both learn in the same step. There, the mask
blocks gradients; here, it passes them straight through. So both are one loss for one
optimiser.
"""

from collections.abc import Callable
from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, Key

from experiments.rpdnet.network import RPDNet
from jradar import training

Maps = Float[Array, "batch doppler range 1"]


class Critic(nn.Module):
    """Features of maps in which only the cells of a mask are left."""

    widths: tuple[int, ...] = (16, 32, 64, 128, 128, 128)

    @nn.compact
    def __call__(self, masked: Maps) -> Any:
        """Apply a 4x4 convolution of stride 2 for each width."""
        x = masked
        for width in self.widths:
            x = nn.Conv(width, (4, 4), (2, 2))(x)
            x = nn.GroupNorm(1, use_scale=False, use_bias=False)(x)
            x = nn.leaky_relu(x, 0.2)
        return x


def rpdnet_params(
    key: Key[Array, ""], detector: RPDNet, shape: tuple[int, int]
) -> dict[str, Any]:
    """Return parameters of the detector and its critic, for maps of `shape`."""
    keys, maps = jax.random.split(key), jnp.zeros((1, *shape, 1))
    return {
        "detector": jax.jit(detector.init)(keys[0], maps),
        "critic": jax.jit(Critic().init)(keys[1], maps),
    }


def make_rpdnet_step(
    detector: RPDNet,
    optimizer: optax.GradientTransformation,
    *,
    adversarial: float,
    ema_decay: float,
) -> Callable[..., Any]:
    """Return the jitted step `(state, key, batch) -> (state, metrics)`.

    `adversarial` is the weight of the critic's distance. The key is not used.
    """

    def loss_of(params, key, batch):
        return rpdnet_loss(
            detector, params, batch.condition, batch.target, weight=adversarial
        )

    return training.make_step(loss_of, optimizer, ema_decay=ema_decay)


def rpdnet_loss(
    detector: RPDNet, params: dict[str, Any], maps: Maps, labels: Maps, *, weight: float
) -> tuple[Float[Array, ""], dict[str, Float[Array, ""]]]:
    """Return focal loss plus `weight` times the distance of features, and both parts.

    The critic increases the distance that the detector decreases.
    """
    logits: Any = detector.apply(params["detector"], maps)
    focal = focal_loss(logits, labels)
    if not weight:
        return focal, {"focal": focal}
    critic = jax.tree.map(  # with its gradient reversed
        lambda x: 2 * jax.lax.stop_gradient(x) - x, params["critic"]
    )
    both = jnp.concatenate([maps * _binarised(logits), maps * labels])
    features: Any = Critic().apply(critic, both)
    found, truth = jnp.split(features, 2)
    distance = jnp.abs(found - truth).mean()
    return focal + weight * distance, {"focal": focal, "distance": distance}


def focal_loss(
    logits: Float[Array, "*cells"],
    labels: Float[Array, "*cells"],
    *,
    gamma: float = 2.0,
) -> Float[Array, ""]:
    """Return the mean cross-entropy, with less weight on cells that are right.

    Lin et al. 2017.
    """
    entropy = optax.sigmoid_binary_cross_entropy(logits, labels)
    return jnp.mean((1 - jnp.exp(-entropy)) ** gamma * entropy)


def _binarised(logits):
    """1 where a cell is marked, with the gradient of the probability."""
    probability = jax.nn.sigmoid(logits)
    marked = (logits > 0).astype(logits.dtype)
    return marked + probability - jax.lax.stop_gradient(probability)
