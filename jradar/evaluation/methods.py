"""Scores of methods: functions from a frame to a cloud, timed and scored alike.

A frame is any object that the methods and truths can read, such as a pair of images. A
truth is a function of the frame too, so that one run can score against several: the
LiDAR's points, and the same points after their range image. Truths stay on the host:
their number of points changes from frame to frame, and JAX would compile for each.
"""

import math
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Key

from jradar.evaluation.scores import COUNTS, DISTANCES, F_SCORES
from jradar.metrics import compare_on_host
from jradar.types import PointCloud

Method = Callable[[Key[Array, ""], Any], PointCloud]
Truth = Callable[[Any], np.ndarray]


def score_frames(
    key: Key[Array, ""],
    frames: Any,
    methods: Mapping[str, Method],
    *,
    truths: Mapping[str, Truth],
    scene: str,
    sequence: str = "",
    warm_up: bool = True,
) -> Iterator[dict[str, Any]]:
    """Yield the scores of each method on each frame of a sequence, against each truth.

    `frames` is a sequence in order of time; a truth returns a frame's points
    `[point, 3]`; rows have the fields of `scores`. All methods get the same key for a
    frame.

    `milliseconds` is the wall time of the method until its cloud is computed. An
    uncounted call on the first frame compiles the method, unless `warm_up` is False.
    """
    if not methods or not truths:
        raise ValueError(
            f"{len(methods)} methods and {len(truths)} truths, expected 1 or more each"
        )
    for index in range(len(frames)):
        frame, frame_key = frames[index], jax.random.fold_in(key, index)
        true_points = {name: truth(frame) for name, truth in truths.items()}
        for name, method in methods.items():
            if warm_up and index == 0:
                jax.block_until_ready(method(frame_key, frame))
            start = time.perf_counter()
            cloud = jax.block_until_ready(method(frame_key, frame))
            milliseconds = 1e3 * (time.perf_counter() - start)
            found = np.asarray(cloud.xyz)[np.asarray(cloud.valid)]
            for truth_name, truth in true_points.items():
                yield {
                    "scene": scene,
                    "sequence": sequence,
                    "frame": index,
                    "truth": truth_name,
                    "method": name,
                    **dict(zip(COUNTS, (len(found), len(truth)), strict=True)),
                    "milliseconds": milliseconds,
                    **_scores(found, truth),
                }


def _scores(found, truth):
    """Scores by name; an empty cloud has no distances and F-scores of 0."""
    if not len(found) or not len(truth):
        f_score = 0.0 if len(truth) else math.nan
        return dict.fromkeys(DISTANCES, math.nan) | dict.fromkeys(F_SCORES, f_score)
    scores = compare_on_host(found, truth)
    distances = (scores.chamfer, scores.modified_hausdorff)
    values = [float(value) for value in (*distances, *scores.f_score)]
    return dict(zip((*DISTANCES, *F_SCORES), values, strict=True))
