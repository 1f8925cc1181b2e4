"""A U-Net whose answer may lie where the radar's points are.

The trunk describes a patch of 16 x 16 pixels by one vector. It cannot say at which of
these pixels there was a point, or how far away. `EvidenceUNet` has a second path to the
head, on the grid of the condition, where nothing is lost:

    condition --smear--> count, place, power  --conv--> anchors, and a correction
    trunk's features --unfold--------------------^

Each point is smeared in space, which is wide in angle when it is near. For
each slice of the range axis, an anchor is the mean range of the points that reach a
pixel, moved by what the network has learnt, with a scale and a weight. Without a point,
the anchor is the middle of its slice. The heaviest anchors of a pixel join the
components of its mixture (`mixture`).
"""

import math

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jradar.diffusion.blocks import conv, unfold
from jradar.diffusion.predictions import ImageOrShape
from jradar.diffusion.unet import Condition, Features, UNet
from jradar.range_code import encode_range

SMEAR = 60  # deviations of a smeared point in the largest range
PARTS = 3  # presence, range and power: the fewest channels of a slice
FAINT = 1e-3  # of a point: less of it does not reach a pixel
FIRST_SCALE = 0.02  # of an anchor, in units of the range code
FIRST_WEIGHT = -2.0  # logit of an anchor that one point supports


class EvidenceUNet(UNet):
    """A `UNet` for the prediction "mixture", with anchors at the radar's points.

    azimuth, elevation, max_range_m, codec
                         view of the images, in radians and metres, and the range code
    anchors              components that join those of the trunk in each pixel; no
                         parameter depends on it
    evidence_channels    width of the second path
    parts                channels of each slice of the condition
    """

    azimuth: tuple[float, float] = (-math.pi / 3, math.pi / 3)
    elevation: tuple[float, float] = (-math.pi / 9, math.pi / 9)
    max_range_m: float = 12.0
    codec: str = "log"
    anchors: int = 1
    evidence_channels: int = 32
    parts: int = PARTS

    def setup(self) -> None:
        """Define the parts of the U-Net, and the second path."""
        super().setup()
        self.evidence = Evidence(
            outputs=self.outputs,
            anchors=self.anchors,
            channels=self.evidence_channels,
            max_range_m=self.max_range_m,
            codec=self.codec,
            parts=self.parts,
        )

    def encode(self, condition: Condition) -> Features:
        """Return the smeared points, and features as the U-Net does."""
        smeared = smear(
            condition,
            azimuth=self.azimuth,
            elevation=self.elevation,
            max_range_m=self.max_range_m,
            parts=self.parts,
        )
        return smeared, *super().encode(condition)

    def decode(
        self, x: ImageOrShape, c_noise: Float[Array, " batch"], features: Features
    ) -> Float[Array, "batch row column output"]:
        """Return the corrected output of the U-Net, then logit, centre and scale.

        The last three are of each anchor; centre and scale are of the range code.
        """
        smeared, *others = features
        image, described = super().described(x, c_noise, others)
        correction, anchors = self.evidence(smeared, described)
        finer = [n // m for n, m in zip(x.shape[1:3], smeared.shape[1:3], strict=True)]
        correction, anchors = (
            part.repeat(finer[0], 1).repeat(finer[1], 2)
            for part in (correction, anchors)
        )
        return jnp.concatenate([image + correction, anchors], -1)


class Evidence(nn.Module):
    """From smeared points and the trunk's features to anchors and a correction."""

    outputs: int
    anchors: int
    channels: int
    max_range_m: float
    codec: str
    parts: int

    @nn.compact
    def __call__(
        self, smeared: Condition, described: Float[Array, "batch _ _ _"]
    ) -> tuple[
        Float[Array, "batch row column output"], Float[Array, "batch row column anchor"]
    ]:
        """Return the correction and the anchors on the grid of the condition."""
        slices = smeared.shape[-1] // self.parts
        stem = [
            n // m
            for n, m in zip(smeared.shape[1:3], described.shape[1:3], strict=True)
        ]
        around = nn.Dense(self.channels // 2 * math.prod(stem), name="unfold")(
            described
        )
        around = nn.silu(unfold(around, stem))
        h = conv(self.channels, jnp.float32, name="conv0")(
            jnp.concatenate([smeared, around], -1)
        )
        h = h + conv(self.channels, jnp.float32, name="conv1")(nn.silu(h))
        zeros = nn.initializers.zeros
        size = self.outputs + 3 * slices
        found = nn.Dense(size, kernel_init=zeros, name="output")(nn.silu(h))
        correction, learnt = found[..., : self.outputs], found[..., self.outputs :]
        return correction, self._heaviest(smeared, learnt)

    def _heaviest(self, smeared, learnt):
        """The anchors of most weight, the heaviest first."""
        count, place, *_ = jnp.split(smeared, self.parts, -1)
        slices = count.shape[-1]
        offset, growth, weight = jnp.split(learnt, 3, -1)
        logit = FIRST_WEIGHT + jnp.log(count + FAINT) / 2 + 4 * weight
        share = (
            jnp.arange(slices)[None, None, None] + (1 + place + offset) / 2
        ) / slices
        range_m = self.max_range_m * share
        centre = encode_range(range_m, max_range_m=self.max_range_m, codec=self.codec)
        scale = FIRST_SCALE * jnp.exp(4 * jnp.tanh(growth))
        logit, chosen = jax.lax.top_k(logit, self.anchors)
        centre, scale = (
            jnp.take_along_axis(part, chosen, -1) for part in (centre, scale)
        )
        return jnp.concatenate([logit, centre, scale], -1)


def smear(
    condition: Condition,
    *,
    azimuth: tuple[float, float],
    elevation: tuple[float, float],
    max_range_m: float,
    parts: int = PARTS,
) -> Condition:
    """Return the count of points that reach each pixel, and means of their channels.

    These are channels of all slices, one after another, as in the condition. A point
    counts less the farther it is: a Gaussian whose deviation is 0.2 m in a
    view of 12 m.
    """
    presence, *others = jnp.split(condition, parts, -1)
    slices = presence.shape[-1]
    middle = (np.arange(slices) + 0.5) * (max_range_m / slices)
    rows, columns = (
        _kernels(size, view, middle, max_range_m / SMEAR, condition.dtype)
        for size, view in zip(condition.shape[1:3], (elevation, azimuth), strict=True)
    )

    def spread(values):
        near = jnp.einsum("sij,bjks->biks", rows, values)
        return jnp.einsum("skl,bils->biks", columns, near)

    count = spread(presence)
    reached = jnp.maximum(count, FAINT)
    means = (spread(presence * part) / reached for part in others)
    return jnp.concatenate([count, *means], -1)


def _kernels(size, view, middle, wide_m, dtype):
    """Weights [slice, pixel, pixel] of points along an axis of the image."""
    step = (view[1] - view[0]) / size
    apart = step * (np.arange(size)[:, None] - np.arange(size))
    return jnp.asarray(
        np.exp(-((apart * middle[:, None, None] / wide_m) ** 2) / 2), dtype
    )
