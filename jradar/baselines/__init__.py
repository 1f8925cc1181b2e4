"""Learned methods that the diffusion model is compared with.

regression_estimate, regression_loss     the same network, trained to answer at once
occupancy_loss                           the same for images of occupied pixels
"""

from jradar.baselines.regression import (
    occupancy_loss as occupancy_loss,
    regression_estimate as regression_estimate,
    regression_loss as regression_loss,
)
