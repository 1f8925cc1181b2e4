"""How long does a cloud take to become a range image, beside NumPy's `minimum.at`?

    python -m benchmarks.bench_range_image

The peers do the whole job, from x, y, z to the image, with two indices per point or
with one flat index, which NumPy handles faster. "scatter alone" starts from indices
that somebody else computed: it says what the angles cost.
"""

import math
import statistics
import time

import jax
import jax.numpy as jnp
import numpy as np

from jradar.range_image import ImageSpec, project, project_slices
from jradar.types import PointCloud

FINE = ImageSpec(height=128, width=512)
COARSE = ImageSpec(height=64, width=64)


def cases():
    """(name, our callable, {peer's name: its callable}) by size and share in view."""
    for num, spread in ((65_536, 1.0), (131_072, 1.0), (65_536, 3.0), (4096, 1.0)):
        yield project_case(num, spread)
    xyz = random_points(4096, 1.0, COARSE)
    cloud = PointCloud.from_xyz(xyz)
    cloud = cloud._replace(power=jnp.ones(4096), velocity=jnp.ones(4096))
    yield (
        "16 slices of 4,096 points with power and velocity to 64 x 64",
        lambda: project_slices(cloud, COARSE, num_slices=16),
        {"minimum.at, one slice, range only": lambda: project_on_host(xyz, COARSE)},
    )


def project_case(num: int, spread: float):
    """A cloud to 128 x 512 pixels; with a spread of 3, most points miss the image."""
    xyz = random_points(num, spread, FINE)
    cloud = PointCloud.from_xyz(xyz)
    row, column, distance = pixels_on_host(xyz, FINE)
    pixel = row * FINE.width + column
    where = "in view" if spread == 1 else "mostly out of view"
    return (
        f"project {num:,} points {where} to 128 x 512",
        lambda: project(cloud, FINE),
        {
            "minimum.at": lambda: project_on_host(xyz, FINE, flat=False),
            "minimum.at, flat": lambda: project_on_host(xyz, FINE),
            "scatter alone": lambda: scatter_on_host((row, column), distance, FINE),
            "scatter alone, flat": lambda: scatter_on_host(pixel, distance, FINE),
        },
    )


def random_points(num: int, spread: float, spec: ImageSpec) -> np.ndarray:
    """Points in `spread` times the field of view, 1 m to 11 m away."""
    rng = np.random.default_rng(0)
    azimuth = rng.uniform(*spec.azimuth, num) * spread
    elevation = rng.uniform(*spec.elevation, num) * spread
    ground = np.cos(elevation)
    xyz = [ground * np.cos(azimuth), ground * np.sin(azimuth), np.sin(elevation)]
    return (np.stack(xyz, -1) * rng.uniform(1, 11, (num, 1))).astype(np.float32)


def pixels_on_host(xyz, spec):
    """Row, column and range of the points in the image, Eq. 7 in NumPy's float32."""
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
    return row, column, distance[inside]


def scatter_on_host(index, distance, spec):
    """Smallest distance of each pixel, 0 where none; one flat index or two."""
    size = spec.height * spec.width
    image = np.full(spec.shape if isinstance(index, tuple) else size, np.inf, "f4")
    np.minimum.at(image, index, distance)
    image[np.isinf(image)] = 0
    return image.reshape(spec.shape)


def project_on_host(xyz, spec, *, flat=True):
    """`project` in NumPy."""
    row, column, distance = pixels_on_host(xyz, spec)
    index = row * spec.width + column if flat else (row, column)
    return scatter_on_host(index, distance, spec)


def compare_speed(cases, *, seconds: float = 2.0):
    """Print each case: compiling, then medians over interleaved rounds, and the ratio.

    The ratio is to the fastest peer that does the whole job.
    """
    for name, ours, peers in cases:
        start = time.perf_counter()
        jax.block_until_ready(ours())
        first = time.perf_counter() - start
        times = _interleaved({"jradar": ours, **peers}, seconds)
        mine = times.pop("jradar")
        print(f"{name}\n  {'jradar':24} {mine:9.3f} ms  (first call {first:.2f} s)")
        for peer, median in times.items():
            print(f"  {peer:24} {median:9.3f} ms  ratio {mine / median:.2f}")
        whole = [time for peer, time in times.items() if "alone" not in peer]
        print(f"  {'ratio to the best peer':24} {mine / min(whole):9.2f}", flush=True)


def _interleaved(functions, seconds):
    """Median milliseconds of each function, called in turn for some seconds."""
    times = {name: [] for name in functions}
    for function in functions.values():
        jax.block_until_ready(function())
    end = time.perf_counter() + seconds
    while time.perf_counter() < end or len(times["jradar"]) < 7:
        for name, function in functions.items():
            start = time.perf_counter()
            jax.block_until_ready(function())
            times[name].append(1e3 * (time.perf_counter() - start))
    return {name: statistics.median(samples) for name, samples in times.items()}


if __name__ == "__main__":
    compare_speed(cases())
