"""Images of metres to the network's values, and back.

The target has two channels: the range, coded to -1 .. 1, and the validity, -1 or 1.
Pixels without a return are marked by their validity alone. Their range is filled
smoothly from their neighbours, so that smoothing the range channel does not create
points between surfaces.

The condition has three channels per slice: presence, the point's place in the
slice (-1 near, 1 far), and its power in decibels relative to the frame's strongest.
Points of several frames have two more: how old the newest in a pixel is, and how many
fell there.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jradar.compiled import jit
from jradar.range_code import decode_range, encode_range
from jradar.range_image.grid import ImageSpec
from jradar.range_image.projection import count_slices, project_slices
from jradar.types import PointCloud

CHANNELS = ("presence", "range", "power")  # of each slice of the condition
OF_HISTORY = (*CHANNELS, "age", "count")
OLDEST_S = 2.0  # the age that is coded as 1
CROWDED = 64.0  # points in a pixel of a slice that are coded as 1
DYNAMIC_RANGE_DB = 60.0  # power further below the strongest point is coded as 0
STEADY = 0.04  # share of the hits; a smaller gain is not a closing pattern
MOST_REACH = 16
ALIKE = 0.05  # share by which two ranges of one surface differ at most

Image = Float[Array, "*batch row column"]
Target = Float[Array, "*batch row column 2"]


@jit(static_argnames=("spec", "codec"))
def encode_target(image: Image, spec: ImageSpec, *, codec: str = "log") -> Target:
    """Return range code and validity of an image in metres, where a miss is 0.

    Where the image is below 0, nothing is known, and the validity is 0.
    """
    hit = image > 0
    code = encode_range(image, max_range_m=spec.max_range_m, codec=codec)
    validity = jnp.where(hit, 1.0, jnp.where(image < 0, 0.0, -1.0))
    return jnp.stack([fill_misses(code, hit), validity], -1)


@jit(static_argnames=("spec", "codec"))
def decode_target(
    values: Target,
    spec: ImageSpec,
    *,
    codec: str = "log",
    validity_threshold: float | Float[Array, ""] = 0.0,
) -> Image:
    """Return the image in metres, 0 where the validity is not above the threshold."""
    range_m = decode_range(values[..., 0], max_range_m=spec.max_range_m, codec=codec)
    return jnp.where(values[..., 1] > validity_threshold, range_m, 0.0)


@jit(static_argnames=("spec", "num_slices", "channels"))
def condition_image(
    cloud: PointCloud,
    spec: ImageSpec,
    *,
    num_slices: int,
    channels: tuple[str, ...] = CHANNELS,
) -> Float[Array, "row column channel"]:
    """Return the network's input for a radar cloud.

    It has the `channels` of all slices, one after another: `CHANNELS`, or `OF_HISTORY`.
    One cloud; `vmap` it.
    """
    slices = project_slices(cloud, spec, num_slices=num_slices)
    present = slices.range_m > 0
    steps = slices.range_m * (num_slices / spec.max_range_m)
    offset = jnp.where(
        present, 2 * (steps - jnp.arange(num_slices)[None, None]) - 1, 0.0
    )
    # Gradients stay finite where the power is 0, of a point or of the whole frame.
    strongest = slices.power.max()
    share = slices.power / jnp.where(strongest > 0, strongest, 1.0)
    below_db = 10 * jnp.log10(jnp.maximum(share, 1e-30))
    power = jnp.where(present, jnp.clip(1 + below_db / DYNAMIC_RANGE_DB, 0.0, 1.0), 0.0)
    found = [present.astype(offset.dtype), offset, power]
    if channels != CHANNELS:
        count, newest = count_slices(cloud, spec, num_slices=num_slices)
        crowd = jnp.log(jnp.maximum(count, 1.0)) / np.log(CROWDED)
        found += [jnp.clip(newest / OLDEST_S, 0.0, 1.0), jnp.minimum(crowd, 1.0)]
    return jnp.concatenate(found, -1)


@jit(static_argnames="reach")
def close_gaps(image: Image, *, reach: int = 2) -> Image:
    """Return `image`, in metres, with the pixels between a LiDAR's beams filled.

    An image is finer than a LiDAR's beams, so a wall has a pattern of empty pixels that
    a radar cannot predict. An empty pixel with returns on opposite sides, in its row,
    column or diagonals and at most `reach` pixels away, is interpolated between them.
    It takes the nearer range if the two differ by more than 5 %.
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
            alike = jnp.abs(one - other) <= ALIKE * nearer
            found = jnp.where(alike, between, nearer)
            filled = jnp.where((filled <= 0) & (nearer > 0), found, filled)
    return filled


@jit(static_argnames="reach")
def observed_pixels(image: Image, *, reach: int) -> Bool[Array, "*batch row column"]:
    """Return the pixels that a scan observed: its hits, and misses away from these.

    A miss within `reach` rows and columns of a hit may lie between two beams. See
    `pattern_reach`.
    """
    hit = image > 0
    window = (1,) * (image.ndim - 2) + (2 * reach + 1, 2 * reach + 1)
    near = jax.lax.reduce_window(
        image, 0.0, jax.lax.max, window, (1,) * image.ndim, "SAME"
    )
    return hit | (near == 0)


def pattern_reach(images: Float[np.ndarray, "*batch row column"]) -> int:
    """Return within how many pixels of a hit a miss may lie between two beams; host.

    The hits are grown by a number of pixels and shrunk again, which closes the holes of
    the pattern. The result is the last number, up to MOST_REACH, that yields a share of
    STEADY more hits than the number before it: 1 for an Ouster of 64 beams, 10 or 11
    for one frame of a Livox Mid-360.
    """
    from scipy import ndimage  # slow to import

    hits = np.asarray(images).reshape(-1, *images.shape[-2:]) > 0
    closed = [np.count_nonzero(hits)]
    for reach in range(1, MOST_REACH + 1):
        wider = np.pad(hits, ((0, 0), *2 * [(2 * reach, 2 * reach)]))
        size = (1, 2 * reach + 1, 2 * reach + 1)
        whole = ndimage.minimum_filter(ndimage.maximum_filter(wider, size), size)
        inside = slice(2 * reach, -2 * reach)
        closed.append(np.count_nonzero(whole[:, inside, inside]))
    grown = np.diff(closed) >= STEADY * np.maximum(closed[:-1], 1)
    return int(np.flatnonzero(grown).max(initial=-1)) + 1


def fill_misses(value: Image, hit: Bool[Array, "*batch row column"]) -> Image:
    """Return `value` with pixels outside `hit` continued smoothly, or 0 without hits.

    Hits are averaged over larger and larger blocks. Each miss is filled from the
    smallest block that contains a hit.
    """
    weight = hit.astype(value.dtype)
    return _fill(value * weight, weight)


def _fill(total, weight):
    """Means of weighted sums; those of weight 0 come from blocks of 2 x 2 pixels."""
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
