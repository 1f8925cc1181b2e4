"""Scores of methods: functions from a frame to a cloud, timed and scored alike.

A frame is any object that the methods and truths can read, such as a pair of images. A
truth is a function from a frame to its true points. One run can score against several
truths, such as the LiDAR's points and the same points after a range image. Truths are
NumPy arrays: JAX would compile anew for each number of points.
"""

import itertools
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float, Key

from jradar.evaluation.scores import COUNTS, DISTANCES, F_SCORES
from jradar.metrics import NEAR_M, compare_on_host, f_score_of, near_truth
from jradar.types import PointCloud

RINGS = 4  # up to the end of the view

Method = Callable[[Key[Array, ""], Any], PointCloud]
Truth = Callable[[Any], np.ndarray]
Scored = Callable[[np.ndarray, np.ndarray], dict[str, float]]  # found, true points
Watch = Callable[[Any, dict[str, Any], PointCloud, np.ndarray], None]


def score_frames(
    key: Key[Array, ""],
    frames: Iterable[Any],
    methods: Mapping[str, Method],
    *,
    truths: Mapping[str, Truth],
    scene: str,
    sequence: str = "",
    size: Callable[[Any], int] = lambda frame: 0,
    compiled: set[int] | None = None,
    watch: Watch | None = None,
    scored: Scored | None = None,
) -> Iterator[dict[str, Any]]:
    """Yield the scores of each method on each frame of a sequence, against each truth.

    `frames` is in order of time. A truth returns a frame's points `[point, 3]`. All
    methods get the same key for a frame. Rows have the fields of `scores`, of which
    `milliseconds` is the wall time of the method. Before the first frame of a `size`,
    an untimed call compiles the method; `compiled` are the sizes that need none, and
    learns those that are seen. `watch` is called with each frame and row, and with the
    cloud and the true points that were compared. `scored` is one of
    `protocols.PROTOCOLS`, by default `score_points`.
    """
    if not methods or not truths:
        raise ValueError(
            f"{len(methods)} methods and {len(truths)} truths, expected 1 or more each"
        )
    compiled = set() if compiled is None else compiled
    for index, frame in enumerate(frames):
        is_new = size(frame) not in compiled
        compiled.add(size(frame))
        frame_key = jax.random.fold_in(key, index)
        true_points = {name: truth(frame) for name, truth in truths.items()}
        for name, method in methods.items():
            if is_new:
                jax.block_until_ready(method(frame_key, frame))
            start = time.perf_counter()
            cloud = jax.block_until_ready(method(frame_key, frame))
            milliseconds = 1e3 * (time.perf_counter() - start)
            found = np.asarray(cloud.xyz)[np.asarray(cloud.valid)]
            for truth_name, truth in true_points.items():
                row = {
                    "scene": scene,
                    "sequence": sequence,
                    "frame": index,
                    "truth": truth_name,
                    "method": name,
                    **dict(zip(COUNTS, (len(found), len(truth)), strict=True)),
                    "milliseconds": milliseconds,
                    **(scored or score_points)(found, truth),
                }
                if watch is not None:
                    watch(frame, row, cloud, truth)
                yield row


def score_points(
    found: Float[np.ndarray, "point 3"], truth: Float[np.ndarray, "other 3"]
) -> dict[str, float]:
    """Return the distances and F-scores of one cloud, by their names in `scores`.

    A cloud without points has no distances and F-scores of 0; against an empty truth
    there are no scores.
    """
    if not len(found) or not len(truth):
        f_score = 0.0 if len(truth) else math.nan
        return dict.fromkeys(DISTANCES, math.nan) | dict.fromkeys(F_SCORES, f_score)
    scores = compare_on_host(found, truth)
    distances = (scores.chamfer, scores.modified_hausdorff)
    values = [float(value) for value in (*distances, *scores.f_score)]
    return dict(zip((*DISTANCES, *F_SCORES), values, strict=True))


def in_larger_view(scored: Scored, unit: float) -> Scored:
    """Return the scores of clouds in a view that is `unit` times as large as usual.

    F-scores are within `unit` times the distances of their names; distances stay in
    metres.
    """

    def larger(found, truth):
        scores = scored(found / unit, truth / unit)
        return scores | {name: unit * scores[name] for name in DISTANCES}

    return larger


def mean_scores(
    clouds: Iterable[np.ndarray], truths: Iterable[np.ndarray], *, unit: float = 1.0
) -> dict[str, float]:
    """Return the mean Chamfer distance and F-score at 0.2 m of clouds `[point, 3]`.

    By the rule of the tables, an empty cloud has no distance and an F-score of 0;
    `empty` is the share of such clouds. A cloud with an empty truth is left out.
    `unit` is as in `in_larger_view`.
    """
    scored = in_larger_view(score_points, unit)
    found = [(c, t) for c, t in zip(clouds, truths, strict=True) if len(t)]
    scores = [scored(cloud, truth) for cloud, truth in found]
    return {
        "chamfer": known_mean(score["chamfer"] for score in scores),
        "f_score_0.2": known_mean(score["f_score_0.2"] for score in scores),
        "empty": known_mean(not len(cloud) for cloud, _ in found),
    }


def known_mean(values: Iterable[float]) -> float:
    """Return the mean of the values that are not NaN, or NaN if there is none."""
    known = [value for value in values if not np.isnan(value)]
    return float(np.mean(known)) if known else np.nan


def ring_edges(max_range_m: float) -> tuple[float, ...]:
    """Return the distances in metres at which rings of equal width begin and end."""
    return tuple(np.linspace(0.0, max_range_m, RINGS + 1).tolist())


def score_rings(
    found: Float[np.ndarray, "point 3"],
    truth: Float[np.ndarray, "other 3"],
    *,
    edges: Sequence[float],
    near_m: float = NEAR_M,
) -> Iterator[dict[str, Any]]:
    """Yield the F-score within `near_m` of each ring.

    Rows have the fields that `summarise` needs.

        radar  |  0 to 3 m  |  3 to 6 m  |  ...

    Precision counts found points of a ring with a true point nearby, recall true points
    of it with a found point nearby, each in any ring. The score is NaN in a ring
    without a true point, and 0 in one without a found point.
    """
    right = near_truth(found, truth, within_m=near_m)
    seen = near_truth(truth, found, within_m=near_m)
    distances = [np.linalg.norm(points, axis=-1) for points in (found, truth)]
    for low, high in itertools.pairwise(edges):
        here, there = ((low <= d) & (d < high) for d in distances)
        precision = right[here].mean() if here.any() else 0.0
        recall = seen[there].mean() if there.any() else 0.0
        score = f_score_of(precision, recall)
        yield {
            "distance": f"{low:g} to {high:g} m",
            "points": int(here.sum()),
            "truth_points": int(there.sum()),
            "f_score_0.2": float(score) if there.any() else math.nan,
        }
