"""How fast does a cloud become a range image, compared with NumPy's `minimum.at`?

The peers do the whole job, from x, y, z to the image, with one flat index per point,
which NumPy handles faster than two. The range on which eight images agree is compared
with a NumPy loop over the images.
"""

import functools
import math
from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.harness import Case
from jradar.range_image import ImageSpec, agreed_range, project
from jradar.range_image.projection import project_slices
from jradar.types import PointCloud

FINE = ImageSpec(height=128, width=512)
COARSE = ImageSpec(height=64, width=64)


def cases() -> Iterator[Case]:
    """Yield projection, slices, and agreement."""
    xyz = random_points(65_536, FINE)
    cloud = PointCloud.from_xyz(xyz)
    yield Case(
        "project 65,536 points in view to 128 x 512",
        lambda: project(cloud, FINE),
        {"minimum.at, flat": lambda: project_on_host(xyz, FINE)},
    )
    for frames in (1, 8, 32):
        yield _slices(frames)
    rng = np.random.default_rng(0)
    draws = rng.uniform(3, 4, (8, *FINE.shape)).astype(np.float32)
    draws *= rng.random(draws.shape) < 0.8
    yield Case(
        "range on which 8 images of 128 x 512 agree",
        lambda: agreed_range(draws).range_m,
        {"NumPy, draw by draw": lambda: agreed_on_host(draws)},
        same=lambda ours, peer: np.allclose(ours, peer, atol=1e-5),
    )


def _slices(frames):
    """Range images of slices, of one frame or by `vmap` of several."""
    few = random_points(4096 * frames, COARSE).reshape(frames, 4096, 3)
    power, velocity = np.random.default_rng(1).random((2, frames, 4096), np.float32)
    cloud = PointCloud(jnp.asarray(few), jnp.ones((frames, 4096), bool))
    cloud = cloud._replace(power=jnp.asarray(power), velocity=jnp.asarray(velocity))
    slices = functools.partial(project_slices, spec=COARSE, num_slices=16)
    together = jax.jit(jax.vmap(slices))

    def on_host():
        each = map(slices_on_host, few, power, velocity)
        return [np.stack(images) for images in zip(*each, strict=True)]

    many = "" if frames == 1 else f"{frames} frames, "
    return Case(
        f"{many}16 slices of 4,096 points with power and velocity to 64 x 64",
        lambda: together(cloud),
        {"minimum.at, three times": on_host},
        same=lambda ours, peer: all(
            np.mean(np.abs(a - b) > 1e-5) < 1e-3  # points on an edge of a pixel
            for a, b in zip(ours, peer, strict=True)
        ),
    )


def random_points(num: int, spec: ImageSpec) -> np.ndarray:
    """Return points in the field of view, 1 m to 11 m away."""
    rng = np.random.default_rng(0)
    azimuth = rng.uniform(*spec.azimuth, num)
    elevation = rng.uniform(*spec.elevation, num)
    ground = np.cos(elevation)
    xyz = [ground * np.cos(azimuth), ground * np.sin(azimuth), np.sin(elevation)]
    return (np.stack(xyz, -1) * rng.uniform(1, 11, (num, 1))).astype(np.float32)


def project_on_host(xyz, spec):
    """`project` in NumPy by Eq. 7, in float32."""
    row, column, distance, _ = pixels_on_host(xyz, spec)
    index = row * spec.width + column
    return _least_on_host(index, distance, spec.height * spec.width).reshape(spec.shape)


def slices_on_host(xyz, power, velocity, spec=COARSE, num_slices=16):
    """`project_slices` in NumPy: range, power and velocity of each pixel and slice."""
    row, column, distance, inside = pixels_on_host(xyz, spec)
    part = (distance * (num_slices / spec.max_range_m)).astype(np.int32)
    part = np.minimum(part, num_slices - 1)
    index = (row * spec.width + column) * num_slices + part
    images, wins = [], np.ones(len(index), bool)
    for sign, values in ((1, distance), (-1, power[inside]), (1, velocity[inside])):
        size = spec.height * spec.width * num_slices
        image = _least_on_host(index[wins], sign * values[wins], size)
        wins &= sign * values == image[index]
        images.append(sign * image.reshape(*spec.shape, num_slices))
    return images


def _least_on_host(index, values, size):
    """The least value of each pixel, 0 without one."""
    image = np.full(size, np.inf, "f4")
    np.minimum.at(image, index, values)
    image[np.isinf(image)] = 0
    return image


def pixels_on_host(xyz, spec):
    """Return row, column and distance of the points in view, and which these are."""
    x, y, z = xyz.T
    distance = np.sqrt(x * x + y * y + z * z)
    columns_per_radian = np.float32(spec.width / np.ptp(spec.azimuth))
    rows_per_radian = np.float32(spec.height / np.ptp(spec.elevation))
    top = np.float32(math.pi / 2 - spec.elevation[1])
    column = (np.arctan2(y, x) - np.float32(spec.azimuth[0])) * columns_per_radian
    row = (np.arccos(z / distance) - top) * rows_per_radian
    inside = (row >= 0) & (row < spec.height) & (column >= 0) & (column < spec.width)
    inside &= distance <= spec.max_range_m
    row, column = row[inside].astype(np.int32), column[inside].astype(np.int32)
    return row, column, distance[inside], inside


def agreed_on_host(images):
    """`agreed_range` in NumPy."""
    most, agreed = np.zeros(images.shape[1:]), np.zeros(images.shape[1:], "f4")
    for image in images:
        near = (np.abs(images - image) <= 0.2) & (images > 0) & (image > 0)
        count = near.sum(0)
        mean = np.where(near, images, 0).sum(0) / np.maximum(count, 1)
        nearer = (count == most) & (mean < agreed)
        agreed = np.where((count > most) | nearer, mean, agreed)
        most = np.maximum(most, count)
    return agreed
