"""Scores as a run would have written them, with numbers that are plain to see."""

import numpy as np
from scipy.signal import lfilter

METHODS = {"OS-CFAR": 3.0, "RPDNet": 1.5, "jradar": 0.8}


def scores(*, scenes=("Hallways", "Outdoor"), frames=40, truths=("LiDAR",)):
    """Return rows of all methods, whose distances wander from frame to frame."""
    rng = np.random.default_rng(5)
    rows = []
    for scene in scenes:
        for sequence in ("run3", "run4"):
            walk = lfilter([0.1], [1, -0.5], rng.normal(size=frames))
            for frame in range(frames):
                for truth in truths:
                    for method, level in METHODS.items():
                        chamfer = level * np.exp(walk[frame] + 0.1 * rng.normal())
                        rows.append(row(scene, sequence, frame, truth, method, chamfer))
    return rows


def row(scene, sequence, frame, truth, method, chamfer, *, points=200):
    """One row; a cloud of no points has no distances and an F-score of 0."""
    found = points > 0
    limits = (0.1, 0.2, 0.5)
    f_scores = {f"f_score_{m}": m / (m + chamfer) if found else 0.0 for m in limits}
    one = {"scene": scene, "sequence": sequence, "frame": frame, "truth": truth}
    one |= {"method": method, "points": points, "truth_points": 3000}
    one |= {"milliseconds": 10 * chamfer if found else 1.0}
    distance = chamfer if found else float("nan")
    return one | {"chamfer": distance, "modified_hausdorff": distance / 8} | f_scores
