r"""Score the confidence of models: does it hold, and what does a threshold on it buy?

    python -m experiments.studies.reliability -o runs/reliability \
        --records runs/smoke/data/records --model jradar-sim

Every point that a model draws counts, also those that it drops by default for their
small confidence. A point is right if the frame's LiDAR cloud has a point within 0.2 m.
Frames without LiDAR points are left out. Several folders of records are scored apart
and together.

`reliability.md` has the calibration error of each model on each folder, and its bins of
confidence; `reliability.png` also its precision over the share of points that are kept.
Do not score a calibrated model on the frames that its calibration was fitted to.
"""

import sys
from argparse import Namespace
from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from experiments.build import build_pairs
from experiments.command import run_study, study_parser
from jradar import data, evaluation, viz
from jradar.errors import UsageError
from jradar.evaluation import (
    Coverage,
    Frame,
    Reliability,
    drawn,
    markdown_table,
    points_of,
    surest_points,
)
from jradar.files import write_text
from jradar.model import Model, load_model
from jradar.progress import progress

KEY = 21
TOGETHER = "all records"
SUREST = (0.1, 0.5)  # shares of points in the first table


class Points(NamedTuple):
    """The points that a model drew on some frames."""

    confidence: Float[np.ndarray, " point"]
    right: Bool[np.ndarray, " point"]
    frames: int

    @property
    def bins(self) -> Reliability:
        """The share of right points in bins of confidence."""
        return evaluation.reliability(self.confidence, self.right)

    @property
    def coverage(self) -> Coverage:
        """The precision of the most confident points."""
        return evaluation.precision_over_coverage(self.confidence, self.right)


Found = dict[tuple[str, str], Points]  # by model, and by records or `TOGETHER`


def main(argv: list[str] | None = None) -> int:
    """Run the study and return the exit code."""
    parser = study_parser("experiments.studies.reliability", __doc__)
    several = {"action": "append", "required": True}
    parser.add_argument(
        "--records", **several, help="folder of `jradar prepare`; can be repeated"
    )
    parser.add_argument("--split", default="test", help="split of the records")
    parser.add_argument(
        "--model", **several, help="shipped model, or a folder; can be repeated"
    )
    parser.add_argument("--every", type=int, default=1, help="score every n-th frame")
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Draw the points of all models, and write the tables and the figure."""
    if options.every < 1:
        raise UsageError(f"--every {options.every}, expected 1 or more")
    models = {name: load_model(name) for name in options.model}
    folders = {
        folder: data.Records(folder, options.split) for folder in options.records
    }
    found: Found = {}
    for name, model in models.items():
        parts = {
            (name, folder): drawn_points(model, records, every=options.every, name=name)
            for folder, records in folders.items()
        }
        if len(parts) > 1:
            parts[name, TOGETHER] = together([*parts.values()])
        found |= parts
    text = report(found)
    write_text(options.output / "reliability.md", text)
    last = {model: points for (model, _), points in found.items()}  # on all records
    figure = viz.reliability_figure(
        {name: points.bins[1:] for name, points in last.items()},
        {name: points.coverage for name, points in last.items()},
    )
    viz.save_figure(figure, options.output / "reliability.png")
    print(f"{text}\nwritten to {options.output}")


def drawn_points(
    model: Model,
    records: Sequence[data.PreparedFrame],
    *,
    every: int = 1,
    name: str = "this model",
) -> Points:
    """Return all points that a model draws on every `every`-th frame of records.

    Raises UsageError for a model that draws no points, or without confidence.
    """
    method, pairs = drawn(model, least_confidence=0.0), build_pairs(model.spec, records)
    key, index = jax.random.key(KEY), range(0, len(records), every)
    found, frames = [np.zeros((0, 2), np.float32)], 0
    with progress(f"scoring {name}", len(index), unit="frames") as show:
        for done, i in enumerate(index, 1):
            frame = records[i]
            show(done, frame.sequence)
            if not len(frame.lidar_xyz):
                continue
            cloud = method(jax.random.fold_in(key, i), Frame(frame, pairs[i]))
            if cloud.confidence is None:
                raise UsageError(
                    f"--model {name} draws by {model.spec.method}, without confidence: "
                    "leave it out"
                )
            right = evaluation.near_truth(points_of(cloud), frame.lidar_xyz)
            confidence = surest_points(cloud)[:, 3]
            found.append(np.stack([confidence, right], -1).astype(np.float32))
            frames += 1
    confidence, right = np.concatenate(found).T
    if not len(right):
        raise UsageError(f"--model {name} drew no points on {len(index)} frames")
    return Points(confidence, right > 0, frames)


def together(parts: Sequence[Points]) -> Points:
    """Return the points of all parts."""
    confidence, right, frames = zip(*parts, strict=True)
    return Points(np.concatenate(confidence), np.concatenate(right), sum(frames))


def report(found: Found) -> str:
    """Return Markdown: a row for each model and folder, then the bins of each model."""
    parts = [summary_table(found)]
    for model, records in {model: records for model, records in found}.items():
        points = found[model, records]
        parts.append(f"## {model}, {records}\n")
        parts += [bins_table(points.bins)]
    return "\n".join(parts)


def summary_table(found: Found) -> str:
    """Return Markdown: the calibration error and precision of each model."""
    titles = ["model", "records", "frames", "points", "mean confidence (%)"]
    titles += ["right (%)", "calibration error (%)"]
    titles += [f"right of the surest {100 * share:g} % (%)" for share in SUREST]
    lines = []
    for place, points in found.items():
        numbers = [points.confidence.mean(dtype=float), points.right.mean()]
        numbers += [evaluation.reliability_error(points.bins)]
        numbers += [*np.interp(SUREST, *points.coverage)]
        counts = [f"{points.frames:,}", f"{len(points.right):,}"]
        lines.append([*place, *counts, *map(percent, numbers)])
    return markdown_table(titles, lines)


def bins_table(bins: Reliability) -> str:
    """Return Markdown: a row for each bin of confidence."""
    edges = np.linspace(0, 100, len(bins.points) + 1)
    lines = [
        [f"{low:g} to {high:g}", f"{number:,}", percent(mean), percent(right)]
        for low, high, number, mean, right in zip(
            edges[:-1], edges[1:], *bins, strict=True
        )
    ]
    titles = ["confidence (%)", "points", "mean confidence (%)", "right (%)"]
    return markdown_table(titles, lines)


def percent(share: float) -> str:
    """Return a share as a percentage, and a dash for NaN."""
    return "–" if np.isnan(share) else f"{100 * share:.1f}"


if __name__ == "__main__":
    sys.exit(main())
