"""Parts of the network: residual block, resampling, embeddings of noise and angle.

A block has one of two published forms:

    "adm"      noise level as scale and shift of the second norm; attention with heads
               (Dhariwal & Nichol 2021; DhariwalUNet in EDM's code)
    "ddpm++"   noise level added; sums scaled by sqrt(1/2); attention with one head
               (Song et al. 2021; SongUNet)
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

FORMS = ("adm", "ddpm++")

Image = Float[Array, "batch row column channel"]
Resized = Float[Array, "batch _row _column _channel"]


class Block(nn.Module):
    """Residual block that takes the noise level, then self-attention if `attend`."""

    channels: int
    form: str = "adm"
    attend: bool = False
    head_channels: int = 64
    group_channels: int = 4
    resample: str = ""
    dtype: Any = jnp.float32

    @nn.compact
    def __call__(
        self, x: Image, embedding: Float[Array, "batch _"]
    ) -> Float[Array, "batch _ _ _"]:
        """Return the output: half or double size for `resample` "down" or "up"."""
        song = self.form == "ddpm++"
        h = resample(nn.silu(self.norm("norm0")(x)), self.resample)
        h = conv(self.channels, self.dtype, name="conv0")(h)
        parameters = self.channels * (1 if song else 2)
        level = nn.Dense(parameters, dtype=self.dtype, name="affine")(embedding)
        level = level[:, None, None]
        if song:
            h = nn.silu(self.norm("norm1")(h + level))
        else:
            scale, shift = jnp.split(level, 2, -1)
            h = nn.silu(self.norm("norm1")(h) * (1 + scale) + shift)
        h = conv(self.channels, self.dtype, zero=True, name="conv1")(h)

        project = x.shape[-1] != self.channels or (song and self.resample)
        x = resample(x, self.resample)
        if project:
            x = nn.Conv(self.channels, (1, 1), dtype=self.dtype, name="skip")(x)
        scale = math.sqrt(0.5) if song else 1.0
        x = (x + h) * scale
        return (x + self.attention(x)) * scale if self.attend else x

    def norm(self, name: str) -> Callable[[Image], Image]:
        """Return the form's group normalisation."""
        epsilon = 1e-6 if self.form == "ddpm++" else 1e-5
        return norm(epsilon, self.dtype, name, group_channels=self.group_channels)

    def attention(self, x: Image) -> Image:
        """Return self-attention over all pixels."""
        batch, rows, columns, channels = x.shape
        heads = 1 if self.form == "ddpm++" else max(1, channels // self.head_channels)
        h = self.norm("norm2")(x).reshape(batch, rows * columns, channels)
        qkv = nn.Dense(3 * channels, dtype=self.dtype, name="qkv")(h)
        q, k, v = jnp.moveaxis(
            qkv.reshape(batch, -1, heads, 3, channels // heads), 3, 0
        )
        h = jax.nn.dot_product_attention(q, k, v).reshape(x.shape)
        zeros = nn.initializers.zeros
        return nn.Dense(channels, kernel_init=zeros, dtype=self.dtype, name="proj")(h)


def conv(
    channels: int, dtype: Any, *, zero: bool = False, name: str | None = None
) -> nn.Conv:
    """Return a 3 x 3 convolution, whose kernel starts at zero if `zero`."""
    init = nn.initializers.zeros if zero else nn.initializers.lecun_normal()
    return nn.Conv(channels, (3, 3), kernel_init=init, dtype=dtype, name=name)


def norm(
    epsilon: float, dtype: Any, name: str | None = None, *, group_channels: int = 4
) -> Callable[[Image], Image]:
    """Return group normalisation in float32: 32 groups, or fewer of `group_channels`.

    EDM's groups have 4 channels or more, OpenAI's 1 or more.
    """

    def apply(x):
        groups = min(32, max(1, x.shape[-1] // group_channels))
        layer = nn.GroupNorm(groups, epsilon=epsilon, dtype=jnp.float32, name=name)
        return layer(x).astype(dtype)

    return apply


def resample(x: Resized, way: str | None) -> Resized:
    """Return means of 2 x 2 pixels ("down"), each pixel four times ("up"), or `x`."""
    if way == "down":
        batch, rows, columns, channels = x.shape
        return x.reshape(batch, rows // 2, 2, columns // 2, 2, channels).mean((2, 4))
    return x.repeat(2, 1).repeat(2, 2) if way == "up" else x


def fold(x: Resized, stem: Sequence[int]) -> Resized:
    """Return `x` with each patch of `stem` pixels as one pixel of more channels.

    The new channels are [row in the patch, column in the patch, channel].
    """
    batch, rows, columns, channels = x.shape
    if rows % stem[0] or columns % stem[1]:
        raise ValueError(
            f"image of {rows} x {columns} pixels, expected a multiple of the patch "
            f"of {stem[0]} x {stem[1]}"
        )
    grid = (rows // stem[0], columns // stem[1])
    x = x.reshape(batch, grid[0], stem[0], grid[1], stem[1], channels)
    return x.transpose(0, 1, 3, 2, 4, 5).reshape(batch, *grid, -1)


def unfold(x: Resized, stem: Sequence[int]) -> Resized:
    """Return channels as patches of `stem` pixels: the inverse of `fold`."""
    batch, rows, columns, channels = x.shape
    x = x.reshape(batch, rows, columns, *stem, channels // math.prod(stem))
    return x.transpose(0, 1, 3, 2, 4, 5).reshape(
        batch, rows * stem[0], columns * stem[1], -1
    )


def noise_embedding(
    c_noise: Float[Array, "..."], channels: int, form: str
) -> Float[Array, "batch feature"]:
    """Return cosines and sines of the noise level at `channels` / 2 frequencies.

    With "ddpm++" the sines come first, and the last frequency is exactly 1 / 10000.
    """
    half = channels // 2
    last = half - 1 if form == "ddpm++" else half
    frequencies = (1 / 10000) ** (np.arange(half) / max(last, 1))
    phase = jnp.outer(c_noise, jnp.asarray(frequencies, c_noise.dtype))
    parts = [jnp.cos(phase), jnp.sin(phase)]
    return jnp.concatenate(parts[::-1] if form == "ddpm++" else parts, -1)


def angle_features(rows: int, columns: int) -> Float[np.ndarray, "row column feature"]:
    """Return Fourier features of elevation and azimuth, `[row, column, feature]`.

    Both angles are mapped to -1 .. 1 over the image. Frequencies double from one
    period over the image to half a period per pixel of the paper's 128 x 512 image
    (Nakashima & Kurazume 2024). Their number does not depend on the image's size.
    """
    features = []
    places = np.meshgrid(_centres(rows), _centres(columns), indexing="ij")
    for place, octaves in zip(places, (7, 9), strict=True):
        phase = place[..., None] * (np.pi * 2.0 ** np.arange(octaves))
        features += [np.sin(phase), np.cos(phase)]
    return np.concatenate(features, -1)


def _centres(size):
    """The centres of `size` pixels on -1 .. 1."""
    return (2 * np.arange(size) + 1) / size - 1
