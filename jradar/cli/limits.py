"""Limits on the points that are written: range, azimuth and elevation."""

import argparse

import numpy as np

from jradar.errors import UsageError
from jradar.types import PointCloud

LIMITS = ("min_range", "max_range", "max_azimuth", "max_elevation")


def check_limits(options: argparse.Namespace) -> None:
    """Raise UsageError if the limits leave no range."""
    nearest, farthest = options.min_range, options.max_range
    if None not in (nearest, farthest) and nearest >= farthest:
        raise UsageError(
            f"--min-range {nearest:g} --max-range {farthest:g}, expected the smaller "
            "one first"
        )


def within_limits(cloud: PointCloud, options: argparse.Namespace) -> PointCloud:
    """Return the cloud with only those points valid that lie within the limits."""
    if all(getattr(options, name) is None for name in LIMITS):
        return cloud
    x, y, z = np.moveaxis(np.asarray(cloud.xyz, np.float64), -1, 0)
    distance = np.sqrt(x**2 + y**2 + z**2)
    azimuth = np.degrees(np.arctan2(y, x))
    elevation = np.degrees(np.arctan2(z, np.hypot(x, y)))
    valid = np.array(cloud.valid)
    if options.min_range is not None:
        valid &= distance >= options.min_range
    for limit, value in (
        (options.max_range, distance),
        (options.max_azimuth, np.abs(azimuth)),
        (options.max_elevation, np.abs(elevation)),
    ):
        if limit is not None:
            valid &= value <= limit
    return cloud._replace(valid=valid)
