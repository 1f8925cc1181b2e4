"""Each method is a function from a frame's pair to a cloud; all are scored alike."""

from collections.abc import Callable, Iterator
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Key

from jradar.data import Pairs
from jradar.metrics import THRESHOLDS_M, compare_on_host
from jradar.range_image import ImageSpec, unproject
from jradar.types import PointCloud

Method = Callable[[Key[Array, ""], Pairs], PointCloud]


def score_frames(
    key: Key[Array, ""], pairs: Pairs, methods: dict[str, Method], *, fine: ImageSpec
) -> Iterator[dict[str, Any]]:
    """Scores of each method on each frame, against the LiDAR image's own points.

    The same key for a frame serves all methods. Distances are in metres.
    """
    for frame in range(len(pairs.lidar)):
        pair = jax.tree.map(lambda x, i=frame: x[i], pairs)
        truth = _points(unproject(pair.lidar, fine))
        for name, method in methods.items():
            found = _points(method(jax.random.fold_in(key, frame), pair))
            scores = compare_on_host(found, truth)
            f_scores = {
                f"f_score_{limit}": float(value)
                for limit, value in zip(THRESHOLDS_M, scores.f_score, strict=True)
            }
            yield {
                "method": name,
                "frame": frame,
                "points": len(found),
                "chamfer": float(scores.chamfer),
                "modified_hausdorff": float(scores.modified_hausdorff),
                **f_scores,
            }


def _points(cloud):
    return np.asarray(cloud.xyz)[np.asarray(cloud.valid)]
