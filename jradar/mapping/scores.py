"""UpPoinTr's protocol for scores of maps."""

import numpy as np
from jaxtyping import Float

THRESHOLD = 0.01  # of a patch that is scaled to a diameter of about 1

Points = Float[np.ndarray, "point 3"]


def published_distance(truth: Points) -> float:
    """Return UpPoinTr's distance in metres, 0.07 to 0.13 m for ColoRadar's patches.

    A patch is scaled by twice the largest distance from the truth's centroid.
    """
    away = np.linalg.norm(truth - truth.mean(0), axis=1)
    return THRESHOLD * 2 * float(away.max())
