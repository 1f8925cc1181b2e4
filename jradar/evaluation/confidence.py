"""The confidence of a model, made to hold on frames that it was not trained on.

A point is right if the LiDAR has one within 0.2 m. The calibration is fitted to the
points of validation frames, and the least confidence that a point must have is the
lowest whose mean F-score is within 1.5 points of the best.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from jradar.data import PairSource, Records
from jradar.evaluation.reliability import near_truth
from jradar.evaluation.statistics import spread
from jradar.metrics import f_score
from jradar.model import Model, draw
from jradar.range_image import (
    IDENTITY,
    ConfidenceTable,
    fit_confidence,
    frequency,
    unproject,
)

FRAMES = 96  # of each folder of records
THRESHOLDS = tuple(np.round(np.arange(0.05, 0.71, 0.05), 2).tolist())
SPARED = 0.015  # of the best F-score, for a denser cloud and a smaller distance


class Judged(NamedTuple):
    """The points of one frame, unsure ones included."""

    xyz: Float[np.ndarray, "point 3"]
    confidence: Float[np.ndarray, " point"]
    right: Bool[np.ndarray, " point"]
    truth: Float[np.ndarray, "true_point 3"]


def with_confidence(key: jax.Array, model: Model, *sets: Records) -> Model:
    """Return the model with a table of confidence that was fitted to these frames.

    A model without confidence, or frames without a point, leave it as it is.
    """
    plain = dataclasses.replace(model, confidence=IDENTITY)
    frames = [frame for records in sets for frame in judged(key, plain, records)]
    confidence = np.concatenate([frame.confidence for frame in frames] or [[]])
    if not len(confidence):
        return model
    right = np.concatenate([frame.right for frame in frames])
    table = fit_confidence(confidence, right)
    frames = [
        frame._replace(confidence=np.asarray(frequency(frame.confidence, table)))
        for frame in frames
    ]
    table = ConfidenceTable.of(table.frequencies, least=least_confidence(frames))
    return dataclasses.replace(model, confidence=table)


def judged(key: jax.Array, model: Model, records: Records) -> Iterator[Judged]:
    """Yield the points of at most `FRAMES` frames that have a truth."""
    spec = model.spec
    grids = {"coarse": spec.coarse, "fine": spec.fine, "num_slices": spec.num_slices}
    pairs = PairSource(records, **grids)
    for i in spread(len(records), FRAMES):
        image = draw(
            jax.random.fold_in(key, i), pairs[i].condition, model, least_confidence=0.0
        )
        truth = np.asarray(records[i].lidar_xyz)
        if image.confidence is None:
            return
        hit = np.asarray(image.range_m).ravel() > 0
        if len(truth):
            xyz = np.asarray(unproject(image.range_m, spec.fine).xyz)[hit]
            confidence = np.asarray(image.confidence).ravel()[hit]
            yield Judged(xyz, confidence, near_truth(xyz, truth), truth)


def least_confidence(frames: Sequence[Judged]) -> float:
    """Return the lowest of THRESHOLDS that scores within SPARED of the best."""

    def score(frame, least):
        return f_score(frame.xyz[frame.confidence >= least], frame.truth)

    scores = [np.mean([score(f, least) for f in frames]) for least in THRESHOLDS]
    good = np.flatnonzero(np.array(scores) >= max(scores) - SPARED)
    return THRESHOLDS[int(good[0])]
