"""Polar images in the plane of one row of antennas: the grid of RadarHD's networks.

image = polar_image(samples, radar.spec)      # of calibrated samples
truth = true_points(scan)                     # the part of a LiDAR's scan in the plane
"""

from jradar.model.grids.polar.answers import (
    PolarImage as PolarImage,
    agreed_occupancy as agreed_occupancy,
    one_pass as one_pass,
)
from jradar.model.grids.polar.axes import (
    LIDAR as LIDAR,
    MAX_RANGE_M as MAX_RANGE_M,
    RADAR as RADAR,
    PolarAxes as PolarAxes,
)
from jradar.model.grids.polar.grid import PolarGrid as PolarGrid
from jradar.model.grids.polar.image import (
    RADARHD as RADARHD,
    azimuth_row as azimuth_row,
    image_features as image_features,
    polar_image as polar_image,
)
from jradar.model.grids.polar.truth import (
    in_plane as in_plane,
    lidar_image as lidar_image,
    true_points as true_points,
)
from jradar.model.mirror import (
    Pixels as Pixels,
    Scaling as Scaling,
    disagreement as disagreement,
    expected_f_score as expected_f_score,
    fit_scaling as fit_scaling,
    least_confidence as least_confidence,
    scaled as scaled,
)
