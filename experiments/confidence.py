r"""The confidence of a model, made to hold on frames that it was not trained on.

    python -m experiments.confidence jradar-sim RECORDS [RECORDS ...] -o FOLDER

A point is right if the LiDAR has one within 0.2 m. `with_confidence` fits the
calibration to the points of validation frames, and chooses the least confidence that a
point must have: the lowest whose mean F-score is within 1.5 points of the best.

Training does this with its own validation frames. The command does it again with the
records of other radars, which have a LiDAR, and writes the model to a new folder. The
network stays the same.
"""

import dataclasses
import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from experiments.build import build_pairs
from experiments.command import run_study, study_parser
from experiments.evaluate import spread
from jradar import data
from jradar.errors import UsageError
from jradar.evaluation import near_truth, score_points
from jradar.model import Model, draw, load_model, save_model
from jradar.range_image import (
    IDENTITY,
    ConfidenceTable,
    fit_confidence,
    frequency,
    unproject,
)

FRAMES = 96  # of each folder of records
KEY = 0
THRESHOLDS = tuple(np.round(np.arange(0.05, 0.71, 0.05), 2).tolist())
DTYPES = {"float32": np.float32, "float16": np.float16, "int8": np.int8}
SPARED = 0.015  # of the best F-score, for a denser cloud and a smaller distance


class Judged(NamedTuple):
    """The points of one frame, unsure ones included."""

    xyz: Float[np.ndarray, "point 3"]
    confidence: Float[np.ndarray, " point"]
    right: Bool[np.ndarray, " point"]
    truth: Float[np.ndarray, "true_point 3"]


def main(argv: list[str] | None = None) -> int:
    """Fit a model's confidence to records and return the exit code."""
    parser = study_parser("experiments.confidence", __doc__, output="new folder")
    parser.add_argument("model", help="a shipped model, or a folder")
    parser.add_argument("records", nargs="+", type=Path, help="folders of records")
    text = "split of the records, or all (default: %(default)s)"
    parser.add_argument("--split", default="validation", help=text)
    text = "precision of the weights that are written"
    parser.add_argument("--dtype", choices=DTYPES, default="float16", help=text)
    return run_study(fit, parser, argv)


def fit(options: Namespace) -> None:
    """Write the model with a confidence that holds on the records."""
    model = load_model(options.model)
    split = None if options.split == "all" else options.split
    sets = [data.Records(folder, split) for folder in options.records]
    fitted = with_confidence(jax.random.key(KEY), model, *sets)
    if fitted is model:
        raise UsageError(
            f"{options.model} gives no confidence, or none of its points has a truth "
            f"in {', '.join(map(str, options.records))}"
        )
    save_model(options.output, fitted, dtype=DTYPES[options.dtype])
    frames = sum(min(len(records), FRAMES) for records in sets)
    print(
        f"{options.output}: confidence fitted to {frames} frames, points of less than "
        f"{fitted.confidence.least:g} are left out"
    )


def with_confidence(key: jax.Array, model: Model, *sets: data.Records) -> Model:
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


def judged(key: jax.Array, model: Model, records: data.Records) -> Iterator[Judged]:
    """Yield the points of at most `FRAMES` frames that have a truth."""
    pairs = build_pairs(model.spec, records)
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

    def f_score(frame, least):
        kept = frame.xyz[frame.confidence >= least]
        return score_points(kept, frame.truth)["f_score_0.2"]

    scores = [np.mean([f_score(f, least) for f in frames]) for least in THRESHOLDS]
    good = np.flatnonzero(np.array(scores) >= max(scores) - SPARED)
    return THRESHOLDS[int(good[0])]


if __name__ == "__main__":
    sys.exit(main())
