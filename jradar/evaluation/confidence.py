"""The confidence of a model, made to hold on frames that it was not trained on.

A point is right if the LiDAR has one within 0.2 m. The calibration is fitted to the
points of validation frames, and the least confidence that a point must have is the
lowest whose mean F-score is within half a point of the best. A point that is not near
an echo must have as much as leaves that F-score as high. The points around the radar's
own have a calibration of their own, and need the highest confidence whose F-score, of
them and the model's, is within half a point of the best.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from jradar.data import PairSource, PreparedFrame
from jradar.evaluation.statistics import spread
from jradar.metrics import near_truth
from jradar.model import Model, draw
from jradar.range_image import (
    IDENTITY,
    ConfidenceTable,
    ImageSpec,
    crowding,
    fit_confidence,
    near_echo,
    surroundings,
    unproject,
)
from jradar.types import PointCloud

FRAMES = 96  # of each folder of records
THRESHOLDS = tuple(np.round(np.arange(0.05, 0.71, 0.05), 2).tolist())
SPARED = 0.005  # of the best F-score, for a denser cloud


class Around(NamedTuple):
    """The points around the radar's own in one frame, by their crowding."""

    xyz: Float[np.ndarray, "point 3"]
    confidence: Float[np.ndarray, " point"]
    right: Bool[np.ndarray, " point"]


class Judged(NamedTuple):
    """The points of one frame, unsure ones included."""

    xyz: Float[np.ndarray, "point 3"]
    confidence: Float[np.ndarray, " point"]
    right: Bool[np.ndarray, " point"]
    truth: Float[np.ndarray, "true_point 3"]
    near: Bool[np.ndarray, " point"] | None = None  # an echo; None: not known
    echoes: Around | None = None


def with_confidence(
    key: jax.Array, model: Model, *sets: Sequence[PreparedFrame]
) -> Model:
    """Return the model with tables of confidence that were fitted to these frames.

    Each set counts as much as another, however many frames it has. A model without
    confidence, or frames without a point, leave it as it is.
    """
    plain = dataclasses.replace(model, confidence=IDENTITY)
    groups = [[*judged(key, plain, records)] for records in sets]
    groups = [group for group in groups if any(len(f.xyz) for f in group)]
    if not groups:
        return model
    table = fitted_confidence(*groups)
    echoes = fitted_echoes(*groups, table=table)
    return dataclasses.replace(model, confidence=table, echoes=echoes)


def fitted_confidence(*groups: Sequence[Judged]) -> ConfidenceTable:
    """Return the table of confidence that was fitted to the points of these frames.

    Each group counts as much as another. Raises ValueError for frames without a point.
    """
    table = fitted_table(groups)
    fitted = [[_calibrated(frame, table) for frame in group] for group in groups]
    least = least_confidence(*fitted)
    alone = least_alone(*fitted, least=least)
    return ConfidenceTable.of(table.frequencies, least=least, least_alone=alone)


def fitted_echoes(
    *groups: Sequence[Judged], table: ConfidenceTable
) -> ConfidenceTable | None:
    """Return the table of the points around the radar's, by their crowding.

    `table` is that of the model's own points. Without a point of the radar, None.
    """
    echoes = [[f.echoes for f in group if f.echoes is not None] for group in groups]
    if not any(len(frame.xyz) for group in echoes for frame in group):
        return None
    found = fitted_table(echoes)
    joined = [[_joined(frame, table, found) for frame in group] for group in groups]
    scores = np.mean([mean_f_scores(group) for group in joined], axis=0)
    good = np.flatnonzero(scores >= scores.max() - SPARED)
    return ConfidenceTable.of(found.frequencies, least=THRESHOLDS[int(good[-1])])


def fitted_table(groups: Sequence[Sequence[Judged | Around]]) -> ConfidenceTable:
    """Return the table whose frequencies were fitted to groups of equal weight."""
    points = [
        (frame.confidence, frame.right, np.full(len(frame.xyz), 1 / len(group)))
        for group in groups
        for frame in group
    ]
    said, right, weights = map(np.concatenate, zip(*points, strict=True))
    return fit_confidence(said, right, weights=weights)


def _calibrated(frame: Judged, table: ConfidenceTable) -> Judged:
    """The frame's points with the confidence of the table."""
    return frame._replace(confidence=_frequency(frame.confidence, table))


def _frequency(confidence, table):
    """`frequency` on the host: JAX would compile it for each number of points."""
    knots = np.linspace(0, 1, len(table.frequencies))
    return np.interp(confidence, knots, table.frequencies)


def _joined(frame: Judged, table: ConfidenceTable, echoes: ConfidenceTable) -> Judged:
    """The points that the model's table keeps, as sure ones, and those of the radar."""
    drawn = _calibrated(frame, table)
    least = table.least
    if frame.near is not None:
        least = np.where(frame.near, least, np.maximum(least, table.least_alone))
    kept = drawn.confidence >= least
    sure = (drawn.xyz[kept], np.ones(kept.sum()), drawn.right[kept])
    if frame.echoes is None:
        return Judged(*sure, frame.truth)
    said = _frequency(frame.echoes.confidence, echoes)
    added = (frame.echoes.xyz, said, frame.echoes.right)
    xyz, said, right = map(np.concatenate, zip(sure, added, strict=True))
    return Judged(xyz, said, right, frame.truth)


def judged(
    key: jax.Array,
    model: Model,
    records: Sequence[PreparedFrame],
    *,
    frames: int = FRAMES,
) -> Iterator[Judged]:
    """Yield the points of at most so many frames that have a truth."""
    spec = model.spec
    grids = {"coarse": spec.coarse, "fine": spec.fine, "num_slices": spec.num_slices}
    pairs = PairSource(records, **grids)
    for i in spread(len(records), frames):
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
            points = records[i].radar
            near = near_echo(image.range_m, points, spec.fine)
            near = np.asarray(near).ravel()[hit]
            yield Judged(
                xyz,
                confidence,
                near_truth(xyz, truth),
                truth,
                near,
                _around(points, truth, spec.fine),
            )


def _around(points: PointCloud, truth: np.ndarray, view: ImageSpec) -> Around:
    """The points around the radar's, with their crowding as confidence."""
    points = points._replace(confidence=crowding(points, view))
    around = surroundings(points, view)
    valid = np.asarray(around.valid)
    xyz, said = (np.asarray(part)[valid] for part in (around.xyz, around.confidence))
    return Around(xyz, said, near_truth(xyz, truth))


def least_confidence(*groups: Sequence[Judged]) -> float:
    """Return the lowest of THRESHOLDS that scores within SPARED of the best.

    The score is the mean over the groups, each with the mean over its frames.
    """
    scores = np.mean([mean_f_scores(group) for group in groups], axis=0)
    return THRESHOLDS[int(np.flatnonzero(scores >= scores.max() - SPARED)[0])]


def least_alone(*groups: Sequence[Judged], least: float) -> float:
    """Return the highest of THRESHOLDS for points alone that costs no F-score.

    Points near an echo need `least`, and so do all where no point is known to be alone.
    """
    if any(frame.near is None for group in groups for frame in group):
        return least

    def staged(frame):
        sure = np.where(frame.confidence >= least, 1.0, 0.0)
        return frame._replace(confidence=np.where(frame.near, sure, frame.confidence))

    staged_groups = [[*map(staged, group)] for group in groups]
    scores = np.mean([mean_f_scores(group) for group in staged_groups], axis=0)
    good = scores >= scores[THRESHOLDS.index(least)]
    return THRESHOLDS[int(np.flatnonzero(good)[-1])]


def mean_f_scores(frames: Sequence[Judged]) -> Float[np.ndarray, " threshold"]:
    """Return the mean F-score at 0.2 m of the points above each of THRESHOLDS."""
    return np.mean([*map(_f_scores, frames)], axis=0)


def _f_scores(frame):
    """F-scores by threshold, from the highest: what is seen there, is seen below."""
    scores, seen = [], np.zeros(len(frame.truth), bool)
    above = np.inf
    for least in reversed(THRESHOLDS):
        kept = frame.confidence >= least
        added = frame.xyz[kept & (frame.confidence < above)]
        seen[~seen] = near_truth(frame.truth[~seen], added)
        precision = frame.right[kept].mean() if kept.any() else 0.0
        both = precision + seen.mean()
        scores.append(2 * precision * seen.mean() / both if both else 0.0)
        above = least
    return scores[::-1]
