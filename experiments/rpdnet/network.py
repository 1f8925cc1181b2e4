"""RPDNet: a network marks the cells of a range-Doppler map that become points.

Cheng, Su, Jiang & Liu, "A Novel Radar Point Cloud Generation Method for Robot
Environment Perception", IEEE Transactions on Robotics 2022. It replaces a CFAR
detector: the angles of the marked cells are found in the classical way.

    map [doppler, range] --1x1--> level 0 --5x5, pool, 5x5--> 1 --pool, 5x5--> 2 ...
                                    |                         |                |
                                   1x1                 1x1, enlarged     1x1, enlarged
                                    +-------------- sum ------+----------------+
                                                     |
                                                    1x1 --> logit of each cell

The pyramid (8 levels, 64 channels, the cells' coordinates as two more inputs) is from
the paper's public code. Normalisation is over each map here, and over batches there.
"""

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

DYNAMIC_RANGE_DB = 80.0  # power further below the strongest cell is clipped

Maps = Float[Array, "batch doppler range 1"]


class RPDNet(nn.Module):
    """Logits of the cells of maps of power, each scaled to 0 .. 1."""

    channels: int = 64
    levels: int = 8

    @nn.compact
    def __call__(self, maps: Maps) -> Maps:
        """Return the logits; levels end early where an axis has a single cell left."""
        shape = maps.shape[1:3]
        x = nn.relu(_norm(nn.Conv(self.channels, (1, 1))(_with_coordinates(maps))))
        total = nn.Conv(self.channels, (1, 1), name="join0")(x)
        for level in range(1, self.levels):
            if min(x.shape[1:3]) < 2:
                break
            if level == 1:
                x = nn.relu(_norm(nn.Conv(self.channels, (5, 5))(x)))
            x = _halved(x)
            x = nn.relu(_norm(nn.Conv(self.channels, (5, 5))(x)))
            # A 1x1 convolution of all levels, concatenated, is a sum of one for each.
            part = nn.Conv(
                self.channels, (1, 1), use_bias=False, name=f"join{level}"
            )(x)  # fmt: skip
            total += _enlarged(part, 2**level, shape)
        return nn.Conv(1, (1, 1), name="logits")(nn.relu(_norm(total)))


def map_values(
    power: Float[np.ndarray, "doppler range"],
) -> Float[np.ndarray, "doppler range"]:
    """Return a map of power in decibels, scaled to 0 .. 1 by its minimum and maximum.

    It runs on the host.
    """
    floor = max(float(power.max()) * 10 ** (-DYNAMIC_RANGE_DB / 10), 1e-30)
    decibels = 10 * np.log10(np.maximum(power, floor))
    low, high = decibels.min(), decibels.max()
    return ((decibels - low) / max(high - low, 1e-6)).astype(np.float32)


def _with_coordinates(maps):
    """Maps with their cells' coordinates, -1 .. 1 along both axes, as channels."""
    rows, columns = maps.shape[1:3]
    places = jnp.meshgrid(
        jnp.linspace(-1, 1, rows), jnp.linspace(-1, 1, columns), indexing="ij"
    )
    places = jnp.broadcast_to(jnp.stack(places, -1), (*maps.shape[:3], 2))
    return jnp.concatenate([maps, places], -1)


def _halved(x):
    """The maximum of each 2 x 2 cells; the last cell of an odd axis stands alone.

    Flax's pooling has a slow gradient on CPUs. That of `max` divides by the number of
    cells that equal the maximum: where XLA rounds the two differently there is none,
    and the gradient is NaN.
    """
    for axis in (1, 2):
        if x.shape[axis] % 2:
            last = jax.lax.slice_in_dim(x, -1, None, axis=axis)
            x = jnp.concatenate([x, last], axis)
    x = jnp.where(x[:, ::2] > x[:, 1::2], x[:, ::2], x[:, 1::2])
    return jnp.where(x[:, :, ::2] > x[:, :, 1::2], x[:, :, ::2], x[:, :, 1::2])


def _enlarged(x, times, shape):
    for axis, size in enumerate(shape, 1):
        x = jnp.repeat(x, times, axis)
        if x.shape[axis] > size:
            x = jax.lax.slice_in_dim(x, 0, size, axis=axis)
    return x


def _norm(x):
    return nn.GroupNorm(1)(x)
