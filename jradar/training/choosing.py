"""The weights that fine-tuning keeps, by scores on new frames and on old ones."""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from jradar.data import PreparedFrame, pairs_of
from jradar.evaluation import (
    MethodInput,
    drawn,
    mean_scores,
    points_of,
    spread,
)
from jradar.evaluation.confidence import THRESHOLDS, judged, mean_f_scores
from jradar.metrics import NEAR_M
from jradar.model import Model
from jradar.training.replay import Old

SCORE = "f_score_0.2"
JUDGED = 32  # validation frames of an evaluation
JUDGED_OLD = 72
HALVINGS = 3  # to find the share of the change of the weights that is kept


class Scores(NamedTuple):
    """Mean scores of own validation frames, and of old frames that were held out."""

    own: dict[str, float]
    old: dict[str, float]  # empty without old frames


class Kept(NamedTuple):
    """A model with a share of the change of the weights, and its scores."""

    model: Model
    share: float
    scores: Scores


def kept_change(
    start: Model,
    tuned: Any,
    checked: Sequence[PreparedFrame],
    old: Old,
    *,
    before: Scores,
    forget: float,
) -> Kept:
    """Return the model with the largest change to `tuned` that forgets little enough.

    All of the change, or a share found by halving the interval. Old frames may lose
    `forget` points. A change that does not score better on own frames is not made.
    """
    kept, most = Kept(start, 0.0, before), 2.0  # all of it is the first middle
    for _ in range(1 + HALVINGS):
        share = (kept.share + most) / 2
        params = _between(start.params, tuned, share)
        model = dataclasses.replace(start, params=params)
        scores = both_scores(model, checked, old)
        forgotten = before.old.get(SCORE, 0) - scores.old.get(SCORE, 0)
        if forgotten > forget / 100:
            most = share
            continue
        kept = Kept(model, share, scores)
        if share == 1:
            break
    better = kept.scores.own[SCORE] > before.own[SCORE]
    return kept if better else Kept(start, 0.0, before)


def both_scores(model: Model, checked: Sequence[PreparedFrame], old: Old) -> Scores:
    """Return the scores of a model on own validation frames, and on old ones."""
    own = frame_scores(model, checked, count=JUDGED)
    if not len(old.checked):
        return Scores(own, {})
    return Scores(own, frame_scores(model, old.checked, count=JUDGED_OLD))


def frame_scores(
    model: Model, records: Sequence[PreparedFrame], *, count: int = JUDGED
) -> dict[str, float]:
    """Return the mean scores of the model's answer to `count` of these frames.

    Scores within 0.2 m are of what is near in the model's view. A model with
    confidence is judged at the least confidence that is best for it, as
    its table is fitted only later.
    """
    key = jax.random.key(0)
    unit = model.spec.frame_grid.near_m / NEAR_M
    if found := [*judged(key, model, records, frames=count)]:
        least = THRESHOLDS[int(np.argmax(mean_f_scores(found)))]
        clouds = [frame.xyz[frame.confidence >= least] for frame in found]
        return mean_scores(clouds, [frame.truth for frame in found], unit=unit)
    pairs = pairs_of(model.spec, records)
    method, index = drawn(model), spread(len(records), count)
    frames = {i: MethodInput(records[i], pairs[i]) for i in index}
    clouds = [method(jax.random.fold_in(key, i), f) for i, f in frames.items()]
    truths = [frame.prepared.lidar_xyz for frame in frames.values()]
    return mean_scores(map(points_of, clouds), truths, unit=unit)


def _between(before: Any, after: Any, share: float) -> Any:
    """Return parameters at a share of the way from those before to those after."""
    return jax.tree.map(
        lambda a, b: np.asarray(a) + np.float32(share) * (np.asarray(b) - a),
        before,
        after,
    )
