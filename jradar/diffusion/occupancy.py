"""The prediction of images whose pixels are 0 or 1, such as occupancy.

The network predicts log-odds F of a pixel from its surroundings and the condition, and
Bayes' rule adds the evidence of the pixel's own noisy value x:

    D(x; sigma) = sigmoid(F + ln(p / (1 - p)) + (x - 1/2) / sigma^2)

where p is the share of occupied pixels, from sigma_data^2 = p (1 - p).
"""

import math
from typing import Any

import jax

from jradar.diffusion.noise import NoiseSpec
from jradar.diffusion.predictions import Prediction, scalings


class Occupancy(Prediction):
    """The prediction of pixels that are 0 or 1; see the module's docstring."""

    def check(self, data: float) -> None:
        """Raise ValueError for a spread that no image of 0 and 1 has."""
        if data > 0.5:
            raise ValueError(
                f"sigma_data = {data}, expected at most 0.5, the largest "
                "standard deviation of pixels that are 0 or 1"
            )

    def denoise(self, network: Any, x: Any, sigma: Any, data: float) -> Any:
        """Return D(x; sigma), the probability of each pixel."""
        _, _, c_in, c_noise = scalings(sigma, data)
        odds = network(c_in[..., None, None, None] * x, c_noise)
        evidence = (x - 0.5) / sigma[..., None, None, None] ** 2
        return jax.nn.sigmoid(odds + _log_odds(data) + evidence)


OCCUPANCY = Occupancy("occupancy")


def prior(noise: NoiseSpec) -> float:
    """Return the log-odds of the share of occupied pixels."""
    return _log_odds(noise.sigma_data)


def _log_odds(data: float) -> float:
    share = (1 - math.sqrt(1 - 4 * data**2)) / 2
    return math.log(share / (1 - share))
