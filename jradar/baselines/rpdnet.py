"""RPDNet: a network marks the cells of a range-Doppler map that are worth a point.

Cheng, Su, Jiang & Liu, "A Novel Radar Point Cloud Generation Method for Robot
Environment Perception", IEEE Transactions on Robotics 2022. It stands where a CFAR
detector does: the angles of the cells that it marks are found in the classical way.

    map [doppler, range] --1x1--> level 0 --5x5, pool, 5x5--> 1 --pool, 5x5--> 2 ...
                                    |                         |                |
                                   1x1                 1x1, enlarged     1x1, enlarged
                                    +-------------- sum ------+----------------+
                                                     |
                                                    1x1 --> logit of each cell

From the paper's public code: the pyramid (8 levels, 64 channels, coordinates of the
cells as two more inputs), the focal loss, and a critic of strided convolutions that
sees the map where a mask is set, once with the network's mask and once with the label,
and learns to tell the two by the distance of its features.

Ours: normalisation is over each map instead of over batches, so that a step stays a
pure function of parameters; the critic's own has no scale, so that its features are
bounded without the clipping of its weights; critic and detector learn in the same step
instead of five to one; the mask passes gradients straight through, which in the public
code it blocks. Both are then one loss for one optimiser.
"""

from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, Key

Maps = Float[Array, "batch doppler range 1"]


class RPDNet(nn.Module):
    """Logits of the cells of maps of power, each scaled to 0 .. 1."""

    channels: int = 64
    levels: int = 8

    @nn.compact
    def __call__(self, maps: Maps) -> Maps:
        """Levels end early where the map can no longer be halved."""
        shape = maps.shape[1:3]
        x = nn.relu(_norm(nn.Conv(self.channels, (1, 1))(_with_coordinates(maps))))
        total = nn.Conv(self.channels, (1, 1), name="join0")(x)
        for level in range(1, self.levels):
            if min(x.shape[1:3]) < 2 or any(size % 2 for size in x.shape[1:3]):
                break
            if level == 1:
                x = nn.relu(_norm(nn.Conv(self.channels, (5, 5))(x)))
            x = _halved(x)
            x = nn.relu(_norm(nn.Conv(self.channels, (5, 5))(x)))
            # The sum of the levels' own 1x1 convolutions is that of all, concatenated.
            part = nn.Conv(
                self.channels, (1, 1), use_bias=False, name=f"join{level}"
            )(x)  # fmt: skip
            total += _enlarged(part, shape)
        return nn.Conv(1, (1, 1), name="logits")(nn.relu(_norm(total)))


class Critic(nn.Module):
    """Features of maps in which only the cells of a mask are left."""

    widths: tuple[int, ...] = (16, 32, 64, 128, 128, 128)

    @nn.compact
    def __call__(self, masked: Maps) -> Any:
        """4x4 convolutions of stride 2, as many as there are widths."""
        x = masked
        for width in self.widths:
            x = nn.Conv(width, (4, 4), (2, 2))(x)
            x = nn.leaky_relu(_norm(x, learned=False), 0.2)
        return x


def rpdnet_params(
    key: Key[Array, ""], detector: RPDNet, shape: tuple[int, int]
) -> dict[str, Any]:
    """Parameters of the detector and of its critic, for maps of `shape`."""
    keys, maps = jax.random.split(key), jnp.zeros((1, *shape, 1))
    return {
        "detector": jax.jit(detector.init)(keys[0], maps),
        "critic": jax.jit(Critic().init)(keys[1], maps),
    }


def focal_loss(
    logits: Float[Array, "*cells"],
    labels: Float[Array, "*cells"],
    *,
    gamma: float = 2.0,
) -> Float[Array, ""]:
    """Mean cross-entropy, less of it where the answer is right already (Lin 2017)."""
    entropy = optax.sigmoid_binary_cross_entropy(logits, labels)
    return jnp.mean((1 - jnp.exp(-entropy)) ** gamma * entropy)


def rpdnet_loss(
    detector: RPDNet, params: dict[str, Any], maps: Maps, labels: Maps, *, weight: float
) -> tuple[Float[Array, ""], dict[str, Float[Array, ""]]]:
    """Focal loss plus `weight` times the distance of the critic's features, and both.

    The critic's gradient has the other sign: it climbs the distance where the detector
    descends it.
    """
    logits: Any = detector.apply(params["detector"], maps)
    focal = focal_loss(logits, labels)
    if not weight:
        return focal, {"focal": focal}
    critic = jax.tree.map(_reversed, params["critic"])
    both = jnp.concatenate([maps * _binarised(logits), maps * labels])
    features: Any = Critic().apply(critic, both)
    found, truth = jnp.split(features, 2)
    distance = jnp.abs(found - truth).mean()
    return focal + weight * distance, {"focal": focal, "distance": distance}


def _binarised(logits):
    """1 where a cell is marked; gradients are those of the probability."""
    probability = jax.nn.sigmoid(logits)
    marked = (logits > 0).astype(logits.dtype)
    return marked + probability - jax.lax.stop_gradient(probability)


def _reversed(x):
    """`x`, but its gradient has the other sign."""
    return 2 * jax.lax.stop_gradient(x) - x


def _with_coordinates(maps):
    """Maps with the places of their cells, -1 .. 1 along both axes, as channels."""
    rows, columns = maps.shape[1:3]
    places = jnp.meshgrid(
        jnp.linspace(-1, 1, rows), jnp.linspace(-1, 1, columns), indexing="ij"
    )
    places = jnp.broadcast_to(jnp.stack(places, -1), (*maps.shape[:3], 2))
    return jnp.concatenate([maps, places], -1)


def _halved(x):
    """The largest of each 2 x 2 cells; the library's gradient is slow on CPUs."""
    batch, rows, columns, channels = x.shape
    return x.reshape(batch, rows // 2, 2, columns // 2, 2, channels).max((2, 4))


def _enlarged(x, shape):
    """Every cell repeated until the map has `shape`."""
    for axis, size in enumerate(shape, 1):
        x = jnp.repeat(x, size // x.shape[axis], axis)
    return x


def _norm(x, *, learned=True):
    """Normalised over all cells and channels of each map."""
    return nn.GroupNorm(1, use_scale=learned, use_bias=learned)(x)
