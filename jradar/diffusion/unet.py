"""The network: EDM's U-Net between a horizontal stem and a head (section IV-C).

    x [row, column] ------------------------------------- detail (full size)
      |  stem: patches of (1, 4) or more pixels               |
      v                                                       v
    level 0  --blocks-------------------------------blocks-- head --> F
      |  + condition, where its grid equals the level's  ^
      v  2 x 2 mean                                      | nearest x 2
    level 1  --blocks----------------------blocks--------+
      v                                      ^
    level 2  --blocks--  attention  --blocks-+

A small separate tower encodes the condition once per frame. Its features enter the
trunk at every level with an equal grid, so radar pixels are never resampled to the
LiDAR's; the layers where they enter start at zero. Fourier features of azimuth and
elevation enter at the stem and in the detail. Parameters are named by level, so they
fit any image size, and the trunk matches EDM's two published forms (`blocks`). Images
are [batch, row, column, channel].
"""

import math
from collections.abc import Sequence
from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jradar.diffusion.blocks import (
    FORMS,
    Block,
    angle_features,
    conv,
    fold,
    noise_embedding,
    norm,
    unfold,
)

TINY: dict[str, Any] = {
    "channels": 128,
    "multipliers": (1, 1),
    "blocks": 1,
    "attention_levels": (1,),
    "stem": (16, 16),
    "condition_stem": (8, 2),
    "condition_channels": 64,
    "detail_channels": 0,
}
PRESETS: dict[str, dict[str, Any]] = {
    "paper": {  # the trunk of EDM's FFHQ and AFHQ networks
        "form": "ddpm++",
        "channels": 128,
        "multipliers": (1, 2, 2, 2),
        "blocks": 4,
        "attention_levels": (2,),
        "stem": (1, 4),
    },
    # Half the patch height of "tiny", and twice the blocks.
    "small": TINY | {"blocks": 2, "stem": (8, 16), "condition_stem": (4, 2)},
    "tiny": TINY,
}

DTYPES = ("float32", "bfloat16", "float64")

Image = Float[Array, "batch row column channel"]
ImageOrShape = Image | jax.ShapeDtypeStruct  # only the shape, of images of zeros
Condition = Float[Array, "batch coarse_row coarse_column slice"]
Features = Sequence[Float[Array, "_ _ _ _"]]  # of one condition per image, or of one


class UNet(nn.Module):
    """F(x; c_noise, condition), split into `encode` per frame and `decode` per step.

    form                 kind of block, "adm" or "ddpm++"
    stem, condition_stem
                         pixels of image and condition in one pixel of their grid
    noise_scale          factor of c_noise
    group_channels       fewest channels in a group of a norm
    detail_channels      channels of the full-size path around the trunk; with 0, the
                         head is a linear map of each patch's features
    condition_at_input   resize the condition to the image and append its channels
                         there, instead of the tower (an ablation)
    angles               enter Fourier features of azimuth and elevation. Without them
                         an image may be a part of a plane, of any size and place
    remat                save memory in training at the cost of time
    dtype                of the computation, or its name: "bfloat16" suits a GPU.
                         Parameters, norms and softmax are float32
    """

    channels: int = 64
    multipliers: tuple[int, ...] = (1, 2, 2, 2)
    blocks: int = 2
    attention_levels: tuple[int, ...] = (3,)
    stem: tuple[int, int] = (1, 4)
    form: str = "adm"
    head_channels: int = 64
    noise_scale: float = 1.0
    detail_channels: int = 16
    condition_channels: int = 32
    condition_stem: tuple[int, int] = (1, 1)
    condition_at_input: bool = False
    outputs: int = 2
    angles: bool = True
    remat: bool = False
    group_channels: int = 4
    dtype: Any = jnp.float32

    def __post_init__(self):
        """Refuse an unknown form of block or type, and groups that cannot be."""
        if self.group_channels < 1:
            raise ValueError(
                f"group_channels = {self.group_channels}, expected 1 or more"
            )
        if self.form not in FORMS:
            raise ValueError(f"form = {self.form!r}, expected one of {FORMS}")
        if (name := getattr(self.dtype, "__name__", str(self.dtype))) not in DTYPES:
            raise ValueError(f"dtype = {name!r}, expected one of {DTYPES}")
        object.__setattr__(self, "dtype", jnp.dtype(self.dtype))  # equal however named
        super().__post_init__()

    def setup(self) -> None:
        """Define the condition's tower and the trunk."""
        self.tower = ConditionTower(
            self.condition_channels,
            len(self.multipliers),
            self.condition_stem,
            dtype=self.dtype,
        )
        shared = Trunk.__annotations__.keys() - {"parent", "name"}
        self.trunk = Trunk(**{name: getattr(self, name) for name in shared})

    def __call__(
        self, x: Image, c_noise: Float[Array, " batch"], condition: Condition
    ) -> Float[Array, "batch row column output"]:
        """Return `decode` of `encode`, for training and initialisation."""
        return self.decode(x, c_noise, self.encode(condition))

    def encode(self, condition: Condition) -> Features:
        """Return features of the condition at its grid and at each half of it."""
        return (condition,) if self.condition_at_input else self.tower(condition)

    def decode(
        self, x: ImageOrShape, c_noise: Float[Array, " batch"], features: Features
    ) -> Float[Array, "batch row column output"]:
        """Return the output for noisy images and features of the condition.

        Features of one condition are used for all images of the batch. Where `x` is
        only a shape, the images are zero, and the stem costs nothing.
        """
        return self.described(x, c_noise, features)[0]

    def described(
        self, x: ImageOrShape, c_noise: Float[Array, " batch"], features: Features
    ) -> tuple[Float[Array, "batch row column output"], Float[Array, "batch _ _ _"]]:
        """Return the output, and the trunk's features of each patch."""
        if not self.condition_at_input:
            return self.trunk(x, c_noise, features)
        x = _filled(x)
        (condition,) = features
        shape = (*condition.shape[:-3], *x.shape[1:3], condition.shape[-1])
        resized = jax.image.resize(condition, shape, "linear")
        resized = jnp.broadcast_to(resized, (*x.shape[:-1], condition.shape[-1]))
        return self.trunk(jnp.concatenate([x, resized], -1), c_noise, ())


class ConditionTower(nn.Module):
    """Features of the condition on coarser and coarser grids."""

    channels: int
    levels: int
    stem: tuple[int, int] = (1, 1)
    dtype: Any = jnp.float32

    @nn.compact
    def __call__(self, condition: Condition) -> Features:
        """Return features at the grid of patches, at half of it, and so on."""
        patches = fold(condition, self.stem)
        x = conv(self.channels, self.dtype, name="input")(patches)
        features = []
        for level in range(self.levels):
            if level:
                x = nn.Conv(
                    self.channels, (3, 3), (2, 2), dtype=self.dtype, name=f"down{level}"
                )(nn.silu(x))
            h = conv(self.channels, self.dtype, name=f"conv{level}")(
                nn.silu(norm(1e-5, self.dtype)(x))
            )
            x = x + h
            features.append(x)
            if min(x.shape[1:3]) < 2 or any(size % 2 for size in x.shape[1:3]):
                break
        return tuple(features)


class Trunk(nn.Module):
    """Stem, U-Net and head; blocks are ordered as in EDM's networks."""

    channels: int
    multipliers: tuple[int, ...]
    blocks: int
    attention_levels: tuple[int, ...]
    stem: tuple[int, int]
    form: str
    head_channels: int
    noise_scale: float
    detail_channels: int
    outputs: int
    angles: bool
    remat: bool
    group_channels: int
    dtype: Any

    @nn.compact
    def __call__(
        self, x: ImageOrShape, c_noise: Float[Array, " batch"], features: Features
    ) -> tuple[Float[Array, "batch row column output"], Float[Array, "batch _ _ _"]]:
        """Return images of the size of `x`, and the features of their patches.

        Raises ValueError for unsuitable sizes.
        """
        self._check(x.shape, features)
        song = self.form == "ddpm++"
        width = [self.channels * m for m in self.multipliers]
        embedding = noise_embedding(
            c_noise * self.noise_scale, self.channels, self.form
        )
        for layer in ("embed0", "embed1"):
            embedding = nn.silu(self._dense(4 * self.channels, layer)(embedding))

        def block(name, channels, *, attend=False, resample=""):
            return (nn.remat(Block) if self.remat else Block)(
                channels,
                form=self.form,
                attend=attend,
                head_channels=self.head_channels,
                group_channels=self.group_channels,
                resample=resample,
                dtype=self.dtype,
                name=name,
            )

        detail = None
        if self.detail_channels:
            detail = self._detail(_filled(x).astype(self.dtype), embedding)
        h = self._stem(x, self.channels if song else width[0])

        skips = []
        for level, channels in enumerate(width):
            if level:
                name = f"enc{level}_down"
                h = block(name, h.shape[-1], resample="down")(h, embedding)
            h = self._add_condition(h, features, level)
            skips.append(h)
            attend = level in self.attention_levels
            for i in range(self.blocks):
                name = f"enc{level}_block{i}"
                h = block(name, channels, attend=attend)(h, embedding)
                skips.append(h)

        last = len(width) - 1
        h = block(f"dec{last}_in0", width[-1], attend=True)(h, embedding)
        h = block(f"dec{last}_in1", width[-1])(h, embedding)
        for level, channels in reversed([*enumerate(width)]):
            if level < last:
                name = f"dec{level}_up"
                h = block(name, h.shape[-1], resample="up")(h, embedding)
            for i in range(self.blocks + 1):
                attend = level in self.attention_levels
                attend &= not song or i == self.blocks
                h = jnp.concatenate([h, skips.pop()], -1)
                name = f"dec{level}_block{i}"
                h = block(name, channels, attend=attend)(h, embedding)
        epsilon = 1e-6 if song else 1e-5
        groups = {"group_channels": self.group_channels}
        h = nn.silu(norm(epsilon, self.dtype, "norm", **groups)(h))
        return self._head(h, detail), h

    def _stem(self, x, channels):
        """Features of patches of the image and of their angles."""
        if isinstance(x, jax.ShapeDtypeStruct) and self.has_variable("params", "stem"):
            # What the convolution makes of zeros, at no cost.
            rows, columns = (
                n // s for n, s in zip(x.shape[1:3], self.stem, strict=True)
            )
            bias = self.variables["params"]["stem"]["bias"].astype(self.dtype)
            h = jnp.broadcast_to(bias, (x.shape[0], rows, columns, channels))
        else:
            patches = fold(_filled(x).astype(self.dtype), self.stem)
            h = conv(channels, self.dtype, name="stem")(patches)
        return h + self._angles(channels, h, "angles")

    def _detail(self, x, embedding):
        """Features of every pixel, scaled and shifted by the noise level."""
        detail = conv(self.detail_channels, self.dtype, name="detail")(x)
        detail += self._angles(self.detail_channels, x, "detail_angles")
        level = self._dense(2 * self.detail_channels, "detail_affine", zero=True)(
            embedding
        )
        scale, shift = jnp.split(level[:, None, None], 2, -1)
        return detail * (1 + scale) + shift

    def _head(self, h, detail):
        """The image plus, with detail, a correction from every pixel."""
        patch = math.prod(self.stem)
        if detail is None:
            coarse = self._dense(self.outputs * patch, "unfold", zero=True)(h)
            return unfold(coarse, self.stem).astype(jnp.float32)
        coarse = conv(self.outputs * patch, self.dtype, zero=True, name="output")(h)
        fine = unfold(self._dense(self.detail_channels * patch, "unfold")(h), self.stem)
        fine = nn.silu(jnp.concatenate([fine, detail], -1))
        fine = conv(self.outputs, self.dtype, zero=True, name="refine")(fine)
        return (unfold(coarse, self.stem) + fine).astype(jnp.float32)

    def _add_condition(self, h, features, level):
        """`h` plus a map of the condition's features at this grid, zero at first."""
        name, grid = f"enc{level}_condition", h.shape[1:3]
        fitting = [feature for feature in features if feature.shape[1:3] == grid]
        if not fitting and self.has_variable("params", name):
            given = [tuple(feature.shape[1:3]) for feature in features]
            raise ValueError(
                f"the condition has grids {given}, none is {tuple(grid)}, where it "
                "entered in training: another image size?"
            )
        # Without angles, a pass from zeros knows nothing but the condition: with zeros
        # both here and in the head, no gradient would reach either.
        for feature in fitting:
            h += self._dense(h.shape[-1], name, zero=self.angles)(feature)
        return h

    def _angles(self, channels, x, name):
        """A linear map of the angles of `x`'s pixels, shared by the batch."""
        if not self.angles:
            return 0
        angles = jnp.asarray(angle_features(*x.shape[1:3]), self.dtype)
        return self._dense(channels, name)(angles)[None]

    def _dense(self, channels, name, *, zero=False):
        init = nn.initializers.zeros if zero else nn.initializers.lecun_normal()
        return nn.Dense(channels, kernel_init=init, dtype=self.dtype, name=name)

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
        if features and not set(grids) & set(given):
            raise ValueError(
                f"the condition has grids {given}, the network {grids}: none match, "
                "so the condition would be ignored; change a stem or an image size"
            )


def _filled(x):
    """Zeros, where `x` is only a shape."""
    return jnp.zeros(x.shape, x.dtype) if isinstance(x, jax.ShapeDtypeStruct) else x
