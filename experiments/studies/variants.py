"""The same recordings, processed in several ways, scored against one truth."""

import dataclasses
from collections.abc import Iterable, Mapping

import jax
import numpy as np
from jaxtyping import Float

from experiments.evaluate import points_of
from jradar import data, evaluation
from jradar.metrics import compare_on_host
from jradar.model import Model, enhance
from jradar.recordings import Recording

KEY = 20
Truths = Mapping[tuple[str, int], Float[np.ndarray, "point 3"]]  # by sequence, frame
Scores = Float[np.ndarray, "frame 2"]  # Chamfer distance (m), F-score at 0.2 m


def truths_of(records: data.Records) -> Truths:
    """Return the LiDAR clouds of prepared frames."""
    return {where: records[i].lidar_xyz for i, where in enumerate(records.where)}


def with_excision(model: Model, wanted: bool) -> Model:
    """Return the model whose points are found with or without excision."""
    points = dataclasses.replace(model.spec.points, remove_interference=wanted)
    spec = dataclasses.replace(model.spec, points=points)
    return dataclasses.replace(model, spec=spec)


def score_recordings(
    model: Model, recordings: Iterable[Recording], truths: Truths
) -> Scores:
    """Return the scores of the frames that have a truth, in its order."""
    opened, rows = {recording.name: recording for recording in recordings}, []
    for number, ((sequence, frame), truth) in enumerate(truths.items()):
        recording = opened[sequence]
        cloud = enhance(
            jax.random.fold_in(jax.random.key(KEY), number),
            recording.cube(frame),
            recording.radar,
            model,
        )
        score = compare_on_host(points_of(cloud), truth)
        rows.append([score.chamfer, np.nan_to_num(score.f_score[1])])
    return np.array(rows)


def score_cells(scores: Scores, before: Scores | None = None) -> list[str]:
    """Return cells: Chamfer distance, F-score, and its gain on `before`."""
    chamfer, f_score = scores.T
    cells = [f"{np.nanmean(chamfer):.2f}", f"{100 * f_score.mean():.1f}"]
    if before is None:
        return [*cells, ""]
    gain = 100 * (f_score - before[:, 1])
    estimate = evaluation.mean_interval([[value] for value in gain])
    return [*cells, f"{estimate.mean:+.1f} ± {estimate.half_width:.1f}"]
