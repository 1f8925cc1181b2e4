"""The confidence of a model, made to hold on frames that it was not trained on.

A point is right if the LiDAR has one within what the grid calls near, 0.2 m in a view
of 12 m. From the points of spared frames
follow, one after another:

1. a table of frequencies: of points with a confidence of 70 %, 70 % are right;
2. for models that answer twice, how much less sure they are where answers disagree;
3. the least confidence of a point: the lowest whose mean F-score is within half a point
   of the best;
4. a table of the points around the radar's own, and their least confidence: the highest
   whose F-score, of them and the model's points, is within half a point of the best;
5. the least confidence of points that no point of the radar supports: the highest that
   costs no F-score.

What a least confidence is relative to, and which points the radar supports, is the
grid's to say. So one procedure serves all models of frames.
"""

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jaxtyping import Bool, Float

from jradar.data import PreparedFrame, pairs_of
from jradar.evaluation.statistics import spread
from jradar.metrics import NEAR_M, f_score_of, near_truth
from jradar.model import FrameGrid, Model, Tables, draw
from jradar.model.mirror import LEAST_ODDS, Pixels, fit_scaling
from jradar.range_image import ConfidenceTable, fit_confidence
from jradar.types import PointCloud

FRAMES = 96  # of each folder of records
THRESHOLDS = tuple(np.round(np.arange(0.05, 0.71, 0.05), 2).tolist())
SPARED = 0.005  # of the best F-score, for a denser cloud
SURROUNDING = 10  # points around each of the radar's
NO_POINTS = PointCloud(jnp.zeros((1, 3)), jnp.zeros(1, bool))


class Judged(NamedTuple):
    """Points of one frame, unsure ones included, and which of them are right."""

    xyz: Float[np.ndarray, "point 3"]
    confidence: Float[np.ndarray, " point"]
    right: Bool[np.ndarray, " point"]
    truth: Float[np.ndarray, "true_point 3"]
    radar: PointCloud | None = None  # its points; None: not known
    disagreement: float | None = None  # of two answers; None of one
    near_m: float = NEAR_M  # within which a point is right

    def kept(self, some: Bool[np.ndarray, " point"], *, sure: bool = False) -> "Judged":
        """Return some of the points, `sure` ones with a confidence of 1."""
        confidence = np.ones(some.sum()) if sure else self.confidence[some]
        chosen = {"xyz": self.xyz[some], "right": self.right[some]}
        return self._replace(confidence=confidence, **chosen)

    def joined(self, other: "Judged") -> "Judged":
        """Return the points of both."""
        parts = zip(self[:3], other[:3], strict=True)
        xyz, confidence, right = map(np.concatenate, parts)
        return self._replace(xyz=xyz, confidence=confidence, right=right)


Groups = Sequence[Sequence[Judged]]


def with_confidence(
    key: jax.Array, model: Model, *sets: Sequence[PreparedFrame]
) -> Model:
    """Return the model with tables of confidence that were fitted to these frames.

    Each set counts as much as another, however many frames it has. A model without
    confidence, or frames without a point, leave it as it is.
    """
    return fitted(model, [[*judged(key, model, records)] for records in sets])


def judged(
    key: jax.Array,
    model: Model,
    records: Sequence[PreparedFrame],
    *,
    frames: int = FRAMES,
) -> Iterator[Judged]:
    """Yield the points of at most so many frames that have a truth.

    Their confidence is the network's own, whatever tables the model has. Raises
    ValueError for a model that records cannot give a condition.
    """
    pairs = pairs_of(model.spec, records)
    for i in spread(len(records), frames):
        frame, each = records[i], jax.random.fold_in(key, i)
        truth = np.asarray(frame.lidar_xyz)
        found = judged_answer(each, model, pairs[i].condition, truth, frame.radar)
        if found is None:
            return
        if len(truth):
            yield found


def judged_answer(
    key: jax.Array,
    model: Model,
    condition: Any,
    truth: Float[np.ndarray, "true_point 3"],
    radar: PointCloud | None,
) -> Judged | None:
    """Return the points of the network's answer; None of one without confidence."""
    plain = Model(model.params, model.spec)
    image = draw(key, condition, plain, least_confidence=0.0)
    if image.confidence is None:
        return None
    cloud = model.spec.frame_grid.cloud(image, NO_POINTS)
    valid = np.asarray(cloud.valid)
    xyz = np.asarray(cloud.xyz)[valid]
    confidence = np.minimum(np.asarray(cloud.confidence)[valid], 1)
    apart = getattr(image, "disagreement", None)
    apart = None if apart is None else float(apart)
    near_m = model.spec.frame_grid.near_m
    right = near_truth(xyz, truth, within_m=near_m)
    return Judged(xyz, confidence, right, truth, radar, apart, near_m)


def fitted(model: Model, groups: Groups) -> Model:
    """Return the model with tables that were fitted to groups of frames.

    Each group counts as much as another. Without a point, the model stays as it is.
    """
    groups = [group for group in groups if any(len(frame.xyz) for frame in group)]
    if not groups:
        return model
    frequencies = fitted_table(groups).frequencies
    table = ConfidenceTable.of(frequencies, least=0.0)
    model = model.with_tables(confidence=table, scaling=None, echoes=None)
    if all(frame.disagreement is not None for group in groups for frame in group):
        parts = (_pixels(frame, model) for group in groups for frame in group)
        model = model.with_tables(scaling=fit_scaling([*parts]))
    grid = model.spec.frame_grid
    said = each(lambda frame: _calibrated(frame, model), groups)
    relative = each(lambda frame: _relative(frame, grid), said)
    least = least_confidence(*relative)
    drawn = each(lambda f, share: f.kept(share.confidence >= least), said, relative)
    model, added = _with_echoes(model, drawn)
    alone = least_alone(drawn, added, grid)
    table = ConfidenceTable.of(frequencies, least=least, least_alone=alone)
    return model.with_tables(confidence=table)


def fitted_table(groups: Groups) -> ConfidenceTable:
    """Return the table whose frequencies were fitted to groups of equal weight."""
    points = [
        (frame.confidence, frame.right, np.full(len(frame.xyz), 1 / len(group)))
        for group in groups
        for frame in group
    ]
    said, right, weights = map(np.concatenate, zip(*points, strict=True))
    return fit_confidence(said, right, weights=weights)


def least_confidence(*groups: Sequence[Judged]) -> float:
    """Return the lowest of THRESHOLDS that scores within SPARED of the best.

    The score is the mean over the groups, each with the mean over its frames.
    """
    scores = _scores(groups)
    return THRESHOLDS[int(np.flatnonzero(scores >= scores.max() - SPARED)[0])]


def least_alone(drawn: Groups, added: Groups, grid: FrameGrid) -> float:
    """Return the highest of THRESHOLDS for points alone that costs no F-score.

    `drawn` are the model's points, `added` those around the radar's that are kept.
    Frames whose radar points are not known do not count; without any, it is 0.
    """

    def staged(frame: Judged, around: Judged) -> Judged:
        near = _supported(frame, around, grid)
        sure = np.where(near, 1.0, frame.confidence)
        return frame._replace(confidence=sure).joined(around)

    frames = [[*zip(*pair, strict=True)] for pair in zip(drawn, added, strict=True)]
    heard = [[f for f in group if f[0].radar is not None] for group in frames]
    if not any(heard):
        return 0.0
    scores = _scores([[staged(*f) for f in group] for group in heard if group])
    good = np.flatnonzero(scores >= scores[0])
    return THRESHOLDS[int(good[-1])]


def mean_f_scores(frames: Sequence[Judged]) -> Float[np.ndarray, " threshold"]:
    """Return the mean F-score at 0.2 m of the points above each of THRESHOLDS."""
    return np.mean([*map(_f_scores, frames)], axis=0)


def _with_echoes(model: Model, drawn: Groups) -> tuple[Model, Groups]:
    """The model with a table of points around the radar's, and those that it keeps."""
    grid = model.spec.frame_grid
    around = each(lambda frame: _around(frame, grid), drawn)
    if not (heard := _heard(around)) or not any(len(f.xyz) for g in heard for f in g):
        return model, around
    table = fitted_table(heard)
    said = each(lambda frame: _tabled(frame, table), around)
    relative = each(lambda frame: _relative(frame, grid), said)
    joined = each(lambda frame, share: _sure(frame).joined(share), drawn, relative)
    scores = _scores(_heard(joined))
    least = THRESHOLDS[int(np.flatnonzero(scores >= scores.max() - SPARED)[-1])]
    kept = each(
        lambda f, share: f.kept(share.confidence >= least, sure=True), said, relative
    )
    echoes = ConfidenceTable.of(table.frequencies, least=least)
    return model.with_tables(echoes=echoes), kept


def each(call: Callable[..., Judged], *groups: Groups) -> list[list[Judged]]:
    """Return the results of a call for each frame of groups, or of several."""
    together = zip(*groups, strict=True)
    return [[call(*fs) for fs in zip(*parts, strict=True)] for parts in together]


def _heard(groups: Groups) -> list[list[Judged]]:
    """The frames whose radar points are known, in groups that have some."""
    kept = ([f for f in group if f.radar is not None] for group in groups)
    return [group for group in kept if group]


def _scores(groups: Groups) -> Float[np.ndarray, " threshold"]:
    """The mean F-score by threshold, over groups."""
    return np.mean([mean_f_scores(group) for group in groups], axis=0)


def _f_scores(frame: Judged) -> list[float]:
    """F-scores by threshold, from the highest: what is seen there, is seen below."""
    scores, seen = [], np.zeros(len(frame.truth), bool)
    above = np.inf
    for least in reversed(THRESHOLDS):
        kept = frame.confidence >= least
        added = frame.xyz[kept & (frame.confidence < above)]
        seen[~seen] = near_truth(frame.truth[~seen], added, within_m=frame.near_m)
        precision = frame.right[kept].mean() if kept.any() else 0.0
        scores.append(float(f_score_of(precision, seen.mean())))
        above = least
    return scores[::-1]


def _sure(frame: Judged) -> Judged:
    """All points, as sure ones."""
    return frame.kept(np.ones(len(frame.xyz), bool), sure=True)


def _tabled(frame: Judged, table: ConfidenceTable) -> Judged:
    """`frequency` on the host: JAX would compile it for each number of points."""
    knots = np.linspace(0, 1, len(table.frequencies))
    found = np.interp(frame.confidence, knots, np.asarray(table.frequencies))
    return frame._replace(confidence=found)


def _pixels(frame: Judged, model: Model) -> Pixels:
    """The points of a frame, with the confidence of the model's table."""
    said = _calibrated(frame, model)
    return Pixels(said.confidence, said.right, frame.disagreement or 0.0)


def _calibrated(frame: Judged, model: Model) -> Judged:
    """The points with the confidence of the model's tables."""
    tables: Tables = model.tables
    frame = _tabled(frame, tables.confidence)
    if (scaling := tables.scaling) is None:
        return frame
    offset, scale = (float(a + b * (frame.disagreement or 0.0)) for a, b in scaling)
    said = np.clip(frame.confidence, LEAST_ODDS, 1 - LEAST_ODDS)
    odds = offset + max(scale, 0.0) * scipy.special.logit(said)
    return frame._replace(
        confidence=np.where(frame.confidence > 0, scipy.special.expit(odds), 0.0)
    )


def _relative(frame: Judged, grid: FrameGrid) -> Judged:
    """The points with their confidence relative to what the grid compares it with."""
    unit = _unit(grid, _padded(frame.confidence[:, None], _pixel_count(grid))[:, 0])
    return frame._replace(confidence=frame.confidence / float(unit))


@functools.partial(jax.jit, static_argnames="grid")
def _unit(grid, confidence):
    """The confidence that a least confidence of 1 asks for in a frame."""
    return grid.least(confidence, ConfidenceTable.of((0, 1), least=1.0))


def _around(frame: Judged, grid: FrameGrid) -> Judged:
    """The points around the radar's, with their crowding as confidence."""
    if frame.radar is None:
        return frame.kept(np.zeros(len(frame.xyz), bool))
    around = grid.surroundings(frame.radar)
    valid = np.asarray(around.valid)
    xyz, said = (np.asarray(part)[valid] for part in (around.xyz, around.confidence))
    right = near_truth(xyz, frame.truth, within_m=frame.near_m)
    return frame._replace(xyz=xyz, confidence=said, right=right)


def _supported(frame: Judged, around: Judged, grid: FrameGrid) -> np.ndarray:
    """Which points the radar's support."""
    assert frame.radar is not None
    count = len(frame.radar.valid) * SURROUNDING
    cloud = _cloud(frame.xyz, _pixel_count(grid))
    near = grid.near(cloud, frame.radar, _cloud(around.xyz, count))
    return np.asarray(near)[: len(frame.xyz)]


def _pixel_count(grid: FrameGrid) -> int:
    return math.prod(grid.image_shape[:2])


def _cloud(xyz: np.ndarray, count: int) -> PointCloud:
    """Points with others after them that are not valid: one shape, compiled once."""
    padded = _padded(xyz, count)
    return PointCloud(padded, jnp.arange(len(padded)) < len(xyz))


def _padded(values: np.ndarray, count: int) -> Any:
    """Rows with zeros after them."""
    padded = np.zeros((max(count, len(values)), values.shape[1]), np.float32)
    padded[: len(values)] = values
    return jnp.asarray(padded)
