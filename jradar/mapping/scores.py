"""Scores of maps: UpPoinTr's protocol, and the F-score at a distance."""

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

THRESHOLD = 0.01  # of a patch that is scaled to a diameter of about 1

Points = Float[np.ndarray, "point 3"]


def f_score(points: Points, truth: Points, distance: float) -> float:
    """Return the harmonic mean of precision and recall at a distance; 0 to 1."""
    if not len(points) or not len(truth):
        return 0.0
    precision = np.mean(KDTree(truth).query(points)[0] < distance)
    recall = np.mean(KDTree(points).query(truth)[0] < distance)
    total = precision + recall
    return float(2 * precision * recall / total) if total else 0.0


def published_distance(truth: Points) -> float:
    """Return UpPoinTr's distance in metres, 0.07 to 0.13 m for ColoRadar's patches.

    A patch is scaled by twice the largest distance from the truth's centroid.
    """
    away = np.linalg.norm(truth - truth.mean(0), axis=1)
    return THRESHOLD * 2 * float(away.max())
