"""The confidence of a trained model, made to hold on frames that it was not trained on.

A point is right if the LiDAR has one within 0.2 m. `with_calibration` fits the
calibration to the points of validation frames, and chooses the least confidence that a
point must have: the lowest whose mean F-score is within 1.5 points of the best.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from experiments.evaluate import spread
from jradar import data
from jradar.evaluation import near_truth
from jradar.metrics import compare_on_host
from jradar.model import Model, draw
from jradar.range_image import calibrated, fit_calibration, unproject

FRAMES = 96
THRESHOLDS = tuple(np.round(np.arange(0.05, 0.71, 0.05), 2).tolist())
SPARED = 0.015  # of the best F-score, for a denser cloud and a smaller distance


class Judged(NamedTuple):
    """The points of one frame, unsure ones included."""

    xyz: Float[np.ndarray, "point 3"]
    confidence: Float[np.ndarray, " point"]
    right: Bool[np.ndarray, " point"]
    truth: Float[np.ndarray, "true_point 3"]


def with_calibration(
    key: jax.Array, model: Model, records: data.Records, pairs: data.PairSource
) -> Model:
    """Return the model with a calibration and a least confidence, from these frames.

    A model without confidence, or frames without a point, leave it as it is.
    """
    plain = dataclasses.replace(model.spec, calibration=None)
    frames = [*judged(key, Model(model.params, plain), records, pairs)]
    confidence = np.concatenate([frame.confidence for frame in frames] or [[]])
    if not len(confidence):
        return model
    right = np.concatenate([frame.right for frame in frames])
    calibration = fit_calibration(confidence, right)
    frames = [
        frame._replace(confidence=np.asarray(calibrated(frame.confidence, calibration)))
        for frame in frames
    ]
    spec = dataclasses.replace(
        plain, calibration=calibration, least_confidence=least_confidence(frames)
    )
    return Model(model.params, spec)


def judged(
    key: jax.Array, model: Model, records: data.Records, pairs: data.PairSource
) -> Iterator[Judged]:
    """Yield the points of at most `FRAMES` frames that have a truth."""
    for i in spread(len(records), FRAMES):
        image = draw(
            jax.random.fold_in(key, i), pairs[i].condition, model, least_confidence=0.0
        )
        truth = np.asarray(records[i].lidar_xyz)
        if image.confidence is None:
            return
        hit = np.asarray(image.range_m).ravel() > 0
        if len(truth):
            xyz = np.asarray(unproject(image.range_m, model.spec.fine).xyz)[hit]
            confidence = np.asarray(image.confidence).ravel()[hit]
            yield Judged(xyz, confidence, near_truth(xyz, truth), truth)


def least_confidence(frames: Sequence[Judged]) -> float:
    """Return the lowest of THRESHOLDS that scores within SPARED of the best."""
    scores = [np.mean([_f_score(f, least) for f in frames]) for least in THRESHOLDS]
    good = np.flatnonzero(np.array(scores) >= max(scores) - SPARED)
    return THRESHOLDS[int(good[0])]


def _f_score(frame: Judged, least: float) -> float:
    """The F-score at 0.2 m of the points of at least this confidence."""
    kept = frame.xyz[frame.confidence >= least]
    if not len(kept):
        return 0.0
    return float(compare_on_host(kept, frame.truth).f_score[1])
