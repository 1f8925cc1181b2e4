"""Directions of the tests' targets, points and rays."""

import numpy as np


def unit(azimuth, elevation):
    """Unit vectors `[..., 3]` towards angles in radians: x ahead, y left, z up."""
    azimuth, elevation = np.broadcast_arrays(azimuth, elevation)
    ground = np.cos(elevation)
    x, y = ground * np.cos(azimuth), ground * np.sin(azimuth)
    return np.stack([x, y, np.sin(elevation)], -1)
