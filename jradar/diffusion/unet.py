"""The network: EDM's U-Net between a horizontal stem and a head (section IV-C).

    x, angles  [row, column]                                        detail (full size)
      |  stem: strides of (1, 4) or larger patches                         |
      v                                                                    |
    level 0  --blocks-------------------------------------------blocks-- head --> F
      |  + condition, where its grid equals the level's              ^
      v  2 x 2 mean                                                  | nearest x 2
    level 1  --blocks----------------------------blocks--------------+
      v                                            ^
    level 2  --blocks--  attention  --blocks-------+

The condition has a small tower of its own, which runs once per frame and enters the
trunk at every level whose grid equals one of its own: radar pixels are never resampled
to the LiDAR's. Its last layer starts at zero. Parameters are named by level, not by
pixels, so the same ones serve any image size. Images are [batch, row, column, channel].
"""

import math
from collections.abc import Sequence
from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

PRESETS: dict[str, dict[str, Any]] = {
    "tiny": {
        "channels": 32,
        "multipliers": (1, 2, 4),
        "blocks": 1,
        "attention_levels": (2,),
        "stem": (2, 8),
    },
}

Image = Float[Array, "batch row column channel"]
Condition = Float[Array, "batch coarse_row coarse_column slice"]
Features = Sequence[Float[Array, "batch _ _ _"]]


class UNet(nn.Module):
    """F(x; c_noise, condition), as `encode` once per frame and `decode` per step."""

    channels: int = 64
    multipliers: tuple[int, ...] = (1, 2, 2, 2)
    blocks: int = 2
    attention_levels: tuple[int, ...] = (3,)
    stem: tuple[int, int] = (1, 4)
    detail_channels: int = 16
    condition_channels: int = 32
    outputs: int = 2
    dtype: Any = jnp.float32

    def setup(self):
        """The tower of the condition and the trunk."""
        self.tower = ConditionTower(
            self.condition_channels, len(self.multipliers), dtype=self.dtype
        )
        self.trunk = Trunk(
            self.channels,
            self.multipliers,
            self.blocks,
            self.attention_levels,
            self.stem,
            self.detail_channels,
            self.outputs,
            dtype=self.dtype,
        )

    def __call__(
        self, x: Image, c_noise: Float[Array, " batch"], condition: Condition
    ) -> Image:
        """`encode` and `decode` in one: what training and initialisation call."""
        return self.decode(x, c_noise, self.encode(condition))

    def encode(self, condition: Condition) -> Features:
        """Features of the condition at its own grid and at each half of it."""
        return self.tower(condition)

    def decode(
        self, x: Image, c_noise: Float[Array, " batch"], features: Features
    ) -> Image:
        """Output of the network for noisy images and the condition's features."""
        return self.trunk(x, c_noise, features)


class ConditionTower(nn.Module):
    """Features of the condition on ever coarser grids."""

    channels: int
    levels: int
    dtype: Any = jnp.float32

    @nn.compact
    def __call__(self, condition: Condition) -> Features:
        """Maps of the grids [row, column], [row / 2, column / 2] ..."""
        x = _conv(self.channels, self.dtype, name="input")(condition)
        features = []
        for level in range(self.levels):
            if level:
                x = nn.Conv(
                    self.channels, (3, 3), (2, 2), dtype=self.dtype, name=f"down{level}"
                )(nn.silu(x))
            h = _conv(self.channels, self.dtype, name=f"conv{level}")(nn.silu(_norm(x)))
            x = x + h
            features.append(x)
            if min(x.shape[1:3]) < 2 or any(size % 2 for size in x.shape[1:3]):
                break
        return tuple(features)


class Trunk(nn.Module):
    """Stem, U-Net and head; levels are entered and left as in EDM's networks."""

    channels: int
    multipliers: tuple[int, ...]
    blocks: int
    attention_levels: tuple[int, ...]
    stem: tuple[int, int]
    detail_channels: int
    outputs: int
    dtype: Any = jnp.float32

    @nn.compact
    def __call__(
        self, x: Image, c_noise: Float[Array, " batch"], features: Features
    ) -> Image:
        """Output of the size of `x`. Raises ValueError where the sizes do not halve."""
        self._check(x.shape, features)
        width = [self.channels * m for m in self.multipliers]
        embedding = _noise_embedding(c_noise, self.channels)
        for layer in ("embed0", "embed1"):
            embedding = nn.silu(
                nn.Dense(4 * self.channels, dtype=self.dtype, name=layer)(embedding)
            )

        def block(name, channels, level, **options):
            attend = level in self.attention_levels
            return Block(channels, attend, name=name, dtype=self.dtype, **options)

        angles = jnp.asarray(_angle_features(x.shape[1], x.shape[2]), x.dtype)
        angles = jnp.broadcast_to(angles, (*x.shape[:3], angles.shape[-1]))
        full = jnp.concatenate([x, angles], -1)
        detail = _conv(self.detail_channels, self.dtype, name="detail")(full)
        kernel = tuple(2 * stride if stride > 1 else 3 for stride in self.stem)
        h = nn.Conv(width[0], kernel, self.stem, dtype=self.dtype, name="stem")(full)

        skips = []
        for level, channels in enumerate(width):
            if level:
                h = block(f"enc{level}_down", channels, None, resample="down")(
                    h, embedding
                )
            for feature in features:
                if feature.shape[1:3] == h.shape[1:3]:
                    h = h + nn.Conv(
                        channels,
                        (1, 1),
                        kernel_init=nn.initializers.zeros,
                        dtype=self.dtype,
                        name=f"enc{level}_condition",
                    )(feature)
            skips.append(h)
            for i in range(self.blocks):
                h = block(f"enc{level}_block{i}", channels, level)(h, embedding)
                skips.append(h)

        last = len(width) - 1
        h = block(f"dec{last}_in0", width[-1], last)(h, embedding)
        h = block(f"dec{last}_in1", width[-1], None)(h, embedding)
        for level, channels in reversed([*enumerate(width)]):
            if level < last:
                h = block(f"dec{level}_up", h.shape[-1], None, resample="up")(
                    h, embedding
                )
            for i in range(self.blocks + 1):
                h = jnp.concatenate([h, skips.pop()], -1)
                h = block(f"dec{level}_block{i}", channels, level)(h, embedding)

        h = nn.silu(_norm(h))
        h = _unfold(
            nn.Conv(
                self.detail_channels * math.prod(self.stem),
                (3, 3),
                dtype=self.dtype,
                name="unfold",
            )(h),
            self.stem,
        )
        h = nn.silu(jnp.concatenate([h, detail], -1))
        return nn.Conv(
            self.outputs,
            (3, 3),
            kernel_init=nn.initializers.zeros,
            dtype=jnp.float32,
            name="output",
        )(h)

    def _check(self, shape, features):
        """Refuse images whose sizes do not halve down to the last level."""
        halvings = 2 ** (len(self.multipliers) - 1)
        for axis, size, stride in zip(
            ("rows", "columns"), shape[1:3], self.stem, strict=True
        ):
            if size % (stride * halvings):
                raise ValueError(
                    f"image of {size} {axis}, expected a multiple of "
                    f"{stride * halvings} (stem {stride} x {halvings} for "
                    f"{len(self.multipliers)} levels)"
                )
        grid = tuple(size // s for size, s in zip(shape[1:3], self.stem, strict=True))
        grids = [tuple(n >> i for n in grid) for i in range(len(self.multipliers))]
        given = [tuple(feature.shape[1:3]) for feature in features]
        if not set(grids) & set(given):
            raise ValueError(
                f"the condition has grids {given}, the network {grids}: none is equal, "
                "so the condition would be ignored; change the stem or an image size"
            )


class Block(nn.Module):
    """Residual block with the noise level as scale and shift, then self-attention."""

    channels: int
    attend: bool = False
    resample: str = ""
    dtype: Any = jnp.float32

    @nn.compact
    def __call__(
        self, x: Image, embedding: Float[Array, "batch _"]
    ) -> Float[Array, "batch _ _ _"]:
        """The block's output, at half or double size where it resamples."""
        h = _resample(nn.silu(_norm(x, "norm0")), self.resample)
        x = _resample(x, self.resample)
        h = _conv(self.channels, self.dtype, name="conv0")(h)
        scale_shift = nn.Dense(2 * self.channels, dtype=self.dtype, name="affine")
        scale, shift = jnp.split(scale_shift(embedding)[:, None, None], 2, -1)
        h = nn.silu(_norm(h, "norm1") * (1 + scale) + shift)
        h = _conv(self.channels, self.dtype, zero=True, name="conv1")(h)
        if x.shape[-1] != self.channels:
            x = nn.Conv(self.channels, (1, 1), dtype=self.dtype, name="skip")(x)
        x = x + h
        return x + self._attention(x) if self.attend else x

    def _attention(self, x):
        """Self-attention over all pixels, with heads of 64 channels."""
        batch, rows, columns, channels = x.shape
        heads = max(1, channels // 64)
        h = _norm(x, "norm2").reshape(batch, rows * columns, channels)
        qkv = nn.Dense(3 * channels, dtype=self.dtype, name="qkv")(h)
        q, k, v = jnp.moveaxis(
            qkv.reshape(batch, -1, heads, 3, channels // heads), 3, 0
        )
        h = jax.nn.dot_product_attention(q, k, v).reshape(x.shape)
        zeros = nn.initializers.zeros
        return nn.Dense(channels, kernel_init=zeros, dtype=self.dtype, name="proj")(h)


def _conv(channels, dtype, *, zero=False, name=None):
    """3 x 3 convolution, starting at zero on request."""
    init = nn.initializers.zeros if zero else nn.initializers.lecun_normal()
    return nn.Conv(channels, (3, 3), kernel_init=init, dtype=dtype, name=name)


def _norm(x, name=None):
    """Group normalisation with EDM's number of groups, in float32."""
    groups = min(32, max(1, x.shape[-1] // 4))
    norm = nn.GroupNorm(groups, epsilon=1e-5, dtype=jnp.float32, name=name)
    return norm(x).astype(x.dtype)


def _resample(x, way):
    """Mean of 2 x 2 pixels, or each pixel four times."""
    if way == "down":
        batch, rows, columns, channels = x.shape
        return x.reshape(batch, rows // 2, 2, columns // 2, 2, channels).mean((2, 4))
    return x.repeat(2, 1).repeat(2, 2) if way == "up" else x


def _unfold(x, stem):
    """Channels to patches of `stem` pixels, the inverse of cutting patches."""
    batch, rows, columns, channels = x.shape
    x = x.reshape(batch, rows, columns, *stem, channels // math.prod(stem))
    return x.transpose(0, 1, 3, 2, 4, 5).reshape(
        batch, rows * stem[0], columns * stem[1], -1
    )


def _noise_embedding(c_noise, channels):
    """Cosines and sines of the noise level at `channels` frequencies."""
    half = channels // 2
    frequencies = (1 / 10000) ** (np.arange(half) / half)
    phase = jnp.outer(c_noise, jnp.asarray(frequencies, c_noise.dtype))
    return jnp.concatenate([jnp.cos(phase), jnp.sin(phase)], -1)


def _angle_features(rows, columns):
    """Fourier features of elevation and azimuth, `[row, column, feature]`.

    Both angles are mapped to -1 .. 1 over the image; frequencies double from half a
    period over the image to half a period per pixel of the paper's 128 x 512 pixels
    (Nakashima & Kurazume 2024). Their number does not depend on the image's size.
    """
    features = []
    places = np.meshgrid(_centres(rows), _centres(columns), indexing="ij")
    for place, octaves in zip(places, (7, 9), strict=True):
        phase = place[..., None] * (np.pi * 2.0 ** np.arange(octaves))
        features += [np.sin(phase), np.cos(phase)]
    return np.concatenate(features, -1)


def _centres(size):
    """Centres of `size` pixels on -1 .. 1."""
    return (2 * np.arange(size) + 1) / size - 1
