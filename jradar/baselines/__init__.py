"""Learned methods that the diffusion model is compared with.

regression_estimate, regression_loss     the same network, trained to answer at once
occupancy_loss                           the same for images of occupied pixels
RPDNet, rpdnet_params, rpdnet_loss       a network in the place of a CFAR detector
map_values, label_cells, sensor_velocities
                                         its input, and its labels from a LiDAR
"""

from jradar.baselines.regression import (
    occupancy_loss as occupancy_loss,
    regression_estimate as regression_estimate,
    regression_loss as regression_loss,
)
from jradar.baselines.rpdnet import (
    RPDNet as RPDNet,
    focal_loss as focal_loss,
    rpdnet_loss as rpdnet_loss,
    rpdnet_params as rpdnet_params,
)
from jradar.baselines.rpdnet_labels import (
    label_cells as label_cells,
    map_values as map_values,
    sensor_velocities as sensor_velocities,
)
