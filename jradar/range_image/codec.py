"""Images of metres to network values and back.

The target has two channels: the range, coded to -1 .. 1, and the validity, -1 or 1.
Pixels without a return hold no edge in the range channel: they are filled smoothly
from their neighbours and recognised by their validity, so that an average of the two
never hangs a point between surfaces.

The condition has up to three channels per slice: presence, where in the slice the point
lies (-1 near, 1 far), and its power in decibels below the frame's strongest.
"""

import functools
import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jradar.range_image.grid import ImageSpec
from jradar.range_image.projection import project_slices
from jradar.types import PointCloud

CODECS = ("log", "linear", "inverse")
CHANNELS = ("presence", "range", "power")  # of each slice of the condition
DYNAMIC_RANGE_DB = 60.0  # weaker points than this below the strongest count as 0

Image = Float[Array, "*batch row column"]
Target = Float[Array, "*batch row column 2"]


def encode_range(
    range_m: Float[Array, "..."], *, max_range_m: float, codec: str = "log"
) -> Float[Array, "..."]:
    """Metres from 0 to `max_range_m` to -1 .. 1; what lies beyond becomes 1."""
    r = jnp.clip(range_m, 0.0, max_range_m)
    if codec == "log":
        unit = jnp.log1p(r) / math.log1p(max_range_m)
    elif codec == "linear":
        unit = r / max_range_m
    elif codec == "inverse":
        unit = r / (1 + r) * ((1 + max_range_m) / max_range_m)
    else:
        raise ValueError(f"codec {codec!r}, expected one of {CODECS}")
    return 2 * unit - 1


def decode_range(
    value: Float[Array, "..."], *, max_range_m: float, codec: str = "log"
) -> Float[Array, "..."]:
    """Inverse of `encode_range`; values outside -1 .. 1 are clipped first."""
    unit = (jnp.clip(value, -1.0, 1.0) + 1) / 2
    if codec == "log":
        return jnp.expm1(unit * math.log1p(max_range_m))
    if codec == "linear":
        return unit * max_range_m
    if codec == "inverse":
        share = unit * (max_range_m / (1 + max_range_m))
        return share / (1 - share)
    raise ValueError(f"codec {codec!r}, expected one of {CODECS}")


@functools.partial(jax.jit, static_argnames=("spec", "codec"))
def encode_target(image: Image, spec: ImageSpec, *, codec: str = "log") -> Target:
    """Range image in metres, 0 for a miss, to range code and validity."""
    hit = image > 0
    code = encode_range(image, max_range_m=spec.max_range_m, codec=codec)
    return jnp.stack([fill_misses(code, hit), jnp.where(hit, 1.0, -1.0)], -1)


@functools.partial(jax.jit, static_argnames=("spec", "codec"))
def decode_target(
    values: Target,
    spec: ImageSpec,
    *,
    codec: str = "log",
    validity_threshold: float | Float[Array, ""] = 0.0,
) -> Image:
    """Range image in metres; 0 where the validity is not above the threshold."""
    range_m = decode_range(values[..., 0], max_range_m=spec.max_range_m, codec=codec)
    return jnp.where(values[..., 1] > validity_threshold, range_m, 0.0)


@functools.partial(jax.jit, static_argnames=("spec", "num_slices", "channels"))
def condition_image(
    cloud: PointCloud,
    spec: ImageSpec,
    *,
    num_slices: int,
    channels: tuple[str, ...] = CHANNELS,
) -> Float[Array, "row column channel"]:
    """What the network sees of a radar cloud, `len(channels) * num_slices` channels.

    One cloud; `vmap` it. Raises ValueError for a channel that there is not.
    """
    if unknown := [name for name in channels if name not in CHANNELS]:
        raise ValueError(f"channel {unknown[0]!r}, expected some of {CHANNELS}")
    slices = project_slices(cloud, spec, num_slices=num_slices)
    present = slices.range_m > 0
    steps = slices.range_m * (num_slices / spec.max_range_m)
    offset = jnp.where(present, 2 * (steps - jnp.arange(num_slices)) - 1, 0.0)
    strongest = jnp.maximum(slices.power.max(), 1e-30)
    below_db = 10 * jnp.log10(jnp.maximum(slices.power / strongest, 1e-30))
    power = jnp.where(present, jnp.clip(1 + below_db / DYNAMIC_RANGE_DB, 0.0, 1.0), 0.0)
    values: dict[str, Array] = dict(
        zip(CHANNELS, (present.astype(offset.dtype), offset, power), strict=True)
    )
    return jnp.concatenate([values[name] for name in channels], -1)


@functools.partial(jax.jit, static_argnames=("reach", "agreement"))
def close_gaps(image: Image, *, reach: int = 2, agreement: float = 0.05) -> Image:
    """`image` of metres with the pixels between neighbouring beams filled.

    An image is finer than a LiDAR's beams, so that a wall has empty pixels in a pattern
    that no radar can tell. One between two returns that face each other, in a row, a
    column or a diagonal, at most `reach` pixels away, lies on the line between them; on
    the nearer one where their ranges differ by more than the share `agreement`.
    """
    margin = [(0, 0)] * (image.ndim - 2) + [(reach, reach)] * 2
    padded = jnp.pad(image, margin)
    rows, columns = image.shape[-2:]

    def shifted(down, right):
        down, right = reach + down, reach + right
        return padded[..., down : down + rows, right : right + columns]

    filled = image
    pairs = [(a, b) for a in range(1, reach + 1) for b in range(1, reach + 1)]
    for a, b in sorted((p for p in pairs if sum(p) <= reach + 1), key=sum):
        for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
            one, other = shifted(-a * down, -a * right), shifted(b * down, b * right)
            nearer = jnp.minimum(one, other)
            between = (b * one + a * other) / (a + b)
            alike = jnp.abs(one - other) <= agreement * nearer
            found = jnp.where(alike, between, nearer)
            filled = jnp.where((filled == 0) & (nearer > 0), found, filled)
    return filled


def fill_misses(value: Image, hit: Bool[Array, "*batch row column"]) -> Image:
    """`value` where `hit`, elsewhere a smooth continuation; 0 if nothing was hit.

    Averages the hits over ever larger blocks, and fills each miss from the smallest
    block that holds one.
    """
    weight = hit.astype(value.dtype)
    return _fill(value * weight, weight)


def _fill(total, weight):
    """Weighted sums to their means, the empty ones from blocks of 2 x 2 pixels."""
    mean = total / jnp.maximum(weight, 1e-12)
    height, width = weight.shape[-2:]
    if height == width == 1:
        return mean
    coarse = _fill(_sum_blocks(total), _sum_blocks(weight))
    near = jax.image.resize(
        coarse, (*coarse.shape[:-2], *(2 * n for n in coarse.shape[-2:])), "linear"
    )[..., :height, :width]
    return jnp.where(weight > 0, mean, near)


def _sum_blocks(image):
    """Sums over blocks of 2 x 2 pixels; odd sizes are padded with 0."""
    *leading, height, width = image.shape
    margins = [(0, 0)] * len(leading) + [(0, height % 2), (0, width % 2)]
    image = jnp.pad(image, margins)
    rows, columns = (height + 1) // 2, (width + 1) // 2
    return image.reshape(*leading, rows, 2, columns, 2).sum((-3, -1))
