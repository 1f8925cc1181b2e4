"""Clouds in the plane of one row of antennas, by networks of polar images.

A radar with one row of antennas measures no elevation. What it can measure is where
surfaces are in its plane: the polar image of a frame, formed as in RadarHD (Prabhakara
et al. 2023), becomes an occupancy image, and that a cloud whose points have height 0.

    image = polar_image(samples, radar.spec)          # of calibrated samples
    answer = plane_image(image[..., None], model)
    cloud = plane_cloud(answer, points, model)      # radar points of all chirps

polar_image, azimuth_row, RADARHD    samples to the polar image; RadarHD's radar
in_plane, true_points, lidar_image   a LiDAR's scan to the true points and image
image_features                       of a polar image, which tell how usual it is
PolarGrid, RADAR, LIDAR, MAX_RANGE_M grids of the radar's image and of the answer
PlanarModel, PlanarSpec, PlanarImage a trained network, and its answer
one_pass, both_ways, plane_image, plane_cloud    conditions to images and to clouds
plane_surroundings, near_points      points around the radar's own, and what is near
Scaling, scaled, disagreement        confidence that falls where two answers disagree
Pixels, fit_scaling                  what it is fitted to
expected_f_score, least_confidence   by which pixels are left out of an image
load_planar_model, describe_planar_model, planar_description    files
"""

from jradar.planar.agreement import (
    UNSCALED as UNSCALED,
    Pixels as Pixels,
    Scaling as Scaling,
    disagreement as disagreement,
    expected_f_score as expected_f_score,
    fit_scaling as fit_scaling,
    least_confidence as least_confidence,
    scaled as scaled,
)
from jradar.planar.evidence import (
    near_points as near_points,
    plane_surroundings as plane_surroundings,
)
from jradar.planar.files import (
    describe_planar_model as describe_planar_model,
    load_planar_model as load_planar_model,
    planar_description as planar_description,
)
from jradar.planar.grid import (
    LIDAR as LIDAR,
    MAX_RANGE_M as MAX_RANGE_M,
    RADAR as RADAR,
    PolarGrid as PolarGrid,
)
from jradar.planar.image import (
    RADARHD as RADARHD,
    azimuth_row as azimuth_row,
    image_features as image_features,
    polar_image as polar_image,
)
from jradar.planar.model import (
    PlanarImage as PlanarImage,
    PlanarModel as PlanarModel,
    PlanarSpec as PlanarSpec,
    both_ways as both_ways,
    one_pass as one_pass,
    plane_cloud as plane_cloud,
    plane_image as plane_image,
)
from jradar.planar.truth import (
    in_plane as in_plane,
    lidar_image as lidar_image,
    true_points as true_points,
)
