"""How fast does a cloud become a range image, compared with NumPy's `minimum.at`?

The peers do the whole job, from x, y, z to the image, with two indices per point or
with one flat index, which NumPy handles faster. The range on which eight images agree
is compared with a NumPy loop over the images.
"""

import math
from collections.abc import Iterator

import jax.numpy as jnp
import numpy as np

from benchmarks.harness import Case
from jradar.range_image import ImageSpec, agreed_range, project, project_slices
from jradar.types import PointCloud

FINE = ImageSpec(height=128, width=512)
COARSE = ImageSpec(height=64, width=64)


def cases() -> Iterator[Case]:
    """Yield clouds of several sizes and fractions in view, slices, and agreement."""
    for num, spread in ((65_536, 1.0), (131_072, 1.0), (65_536, 3.0), (4096, 1.0)):
        yield project_case(num, spread)
    xyz = random_points(4096, 1.0, COARSE)
    cloud = PointCloud.from_xyz(xyz)
    power, velocity = np.random.default_rng(1).random((2, 4096), np.float32)
    cloud = cloud._replace(power=jnp.asarray(power), velocity=jnp.asarray(velocity))
    yield Case(
        "16 slices of 4,096 points with power and velocity to 64 x 64",
        lambda: project_slices(cloud, COARSE, num_slices=16),
        {"minimum.at, three times": lambda: slices_on_host(xyz, power, velocity)},
        same=lambda ours, peer: all(
            np.mean(np.abs(a - b) > 1e-5) < 1e-3  # points on an edge of a pixel
            for a, b in zip(ours, peer, strict=True)
        ),
    )
    rng = np.random.default_rng(0)
    draws = rng.uniform(3, 4, (8, *FINE.shape)).astype(np.float32)
    draws *= rng.random(draws.shape) < 0.8
    yield Case(
        "range on which 8 images of 128 x 512 agree",
        lambda: agreed_range(draws).range_m,
        {"NumPy, draw by draw": lambda: agreed_on_host(draws)},
        same=lambda ours, peer: np.allclose(ours, peer, atol=1e-5),
    )


def project_case(num: int, spread: float) -> Case:
    """Return the projection of a cloud; with a spread of 3, most points miss it."""
    xyz = random_points(num, spread, FINE)
    cloud = PointCloud.from_xyz(xyz)
    where = "in view" if spread == 1 else "mostly out of view"
    return Case(
        f"project {num:,} points {where} to 128 x 512",
        lambda: project(cloud, FINE),
        {
            "minimum.at": lambda: project_on_host(xyz, FINE, flat=False),
            "minimum.at, flat": lambda: project_on_host(xyz, FINE),
        },
    )


def random_points(num: int, spread: float, spec: ImageSpec) -> np.ndarray:
    """Return points in `spread` times the field of view, 1 m to 11 m away."""
    rng = np.random.default_rng(0)
    azimuth = rng.uniform(*spec.azimuth, num) * spread
    elevation = rng.uniform(*spec.elevation, num) * spread
    ground = np.cos(elevation)
    xyz = [ground * np.cos(azimuth), ground * np.sin(azimuth), np.sin(elevation)]
    return (np.stack(xyz, -1) * rng.uniform(1, 11, (num, 1))).astype(np.float32)


def project_on_host(xyz, spec, *, flat=True):
    """`project` in NumPy by Eq. 7, in float32, with one flat index or two."""
    row, column, distance, _ = pixels_on_host(xyz, spec)
    index = row * spec.width + column if flat else (row, column)
    image = np.full(spec.height * spec.width if flat else spec.shape, np.inf, "f4")
    np.minimum.at(image, index, distance)
    image[np.isinf(image)] = 0
    return image.reshape(spec.shape)


def slices_on_host(xyz, power, velocity, spec=COARSE, num_slices=16):
    """`project_slices` in NumPy: range, power and velocity of each pixel and slice."""
    row, column, distance, inside = pixels_on_host(xyz, spec)
    part = (distance * (num_slices / spec.max_range_m)).astype(np.int32)
    part = np.minimum(part, num_slices - 1)
    index = (row * spec.width + column) * num_slices + part
    images, wins = [], np.ones(len(index), bool)
    for sign, values in ((1, distance), (-1, power[inside]), (1, velocity[inside])):
        image = np.full(spec.height * spec.width * num_slices, np.inf, "f4")
        np.minimum.at(image, index[wins], sign * values[wins])
        wins &= sign * values == image[index]
        image[np.isinf(image)] = 0
        images.append(sign * image.reshape(*spec.shape, num_slices))
    return images


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


def agreed_on_host(images, tolerance_m=0.2):
    """`agreed_range` in NumPy."""
    most, agreed = np.zeros(images.shape[1:]), np.zeros(images.shape[1:], "f4")
    for image in images:
        near = (np.abs(images - image) <= tolerance_m) & (images > 0) & (image > 0)
        count = near.sum(0)
        mean = np.where(near, images, 0).sum(0) / np.maximum(count, 1)
        nearer = (count == most) & (mean < agreed)
        agreed = np.where((count > most) | nearer, mean, agreed)
        most = np.maximum(most, count)
    return agreed
