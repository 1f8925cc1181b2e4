r"""What are models worth on the points of a chip and of a capture card, in histories?

    python -m experiments.places --set=jradar-sim-6 --maps=ColoRadar -o runs/sim6
    python -m experiments.studies.histories runs/sim6 -o runs/compared

The last frame of each walk (`jradar-sim-6`) is asked, with the points of 1 and of 10
frames: all weak cells, as a capture card gives them, and what TI's chip sends (CASO,
peaks grouped, the 120 strongest, rounded). Rows are the points themselves, `splat`,
which smears them, and the models, which all get the same points. `details.md` has the
F-scores by kind of place and by distance, and how right the models' confidence is.
"""

import sys
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np

from experiments.command import run_study, study_parser
from jradar import load_model
from jradar.data import Records, pairs_of
from jradar.data.histories import History, HistorySpec, Sender
from jradar.evaluation import (
    MethodInput,
    drawn,
    in_view,
    markdown_table,
    points_of,
    reliability,
    ring_edges,
    score_points,
    score_rings,
    smeared,
    surest_points,
    write_scores,
    write_tables,
)
from jradar.files import write_text
from jradar.metrics import near_truth
from jradar.model import Model
from jradar.progress import progress
from jradar.radar import PointSpec
from jradar.simulation.drawn import kind_of

CASO = PointSpec(detector="so", false_alarm_rate=1e-3, group_peaks=True)
SENDERS = {"card": Sender(), "chip": Sender(CASO, most=120, step_m=1 / 128)}
FRAMES = (1, 10)
EDGES = ring_edges(12.0)


def main(argv: list[str] | None = None) -> int:
    """Write scores and tables, and return the exit code."""
    parser = study_parser("experiments.studies.histories", __doc__)
    parser.add_argument("records", type=Path, help="of jradar-sim-6")
    parser.add_argument("--model", action="append", default=[], help="repeatable")
    parser.add_argument("--split", default="validation")
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Score the models with each kind of points and each number of frames."""
    records = Records(options.records, options.split)
    models = {name: load_model(name) for name in options.model or ["jradar-sim"]}
    rows, judged = [], {}
    for row, points, truth in answers(records, models):
        rows.append(row | score_points(points[:, :3], truth))
        rows[-1]["rings"] = [*score_rings(points[:, :3], truth, edges=EDGES)]
        if points.shape[1] > 3 and len(truth):
            right = near_truth(points[:, :3], truth)
            about = judged.setdefault((row["scene"], row["method"]), ([], []))
            about[0].append(points[:, 3])
            about[1].append(right)
    kinds = [(r, kind_of(r["sequence"]), r["f_score_0.2"]) for r in rows]
    rings = [
        (row, ring["distance"], ring["f_score_0.2"])
        for row in rows
        for ring in row.pop("rings")
    ]
    write_scores(options.output / "frames.jsonl", rows)
    write_tables(options.output / "frames.jsonl")
    tables = [_by("kind", kinds), _by("distance", rings), _confidences(judged)]
    write_text(options.output / "details.md", "\n".join(tables))


def answers(
    records: Records, models: dict[str, Model]
) -> Iterator[tuple[dict[str, Any], np.ndarray, np.ndarray]]:
    """Yield the points of each walk, sender, number of frames and method, and truth."""
    last = {name: index for index, (name, _) in enumerate(records.where)}
    with progress("walks", len(last)) as show:
        for number, (name, index) in enumerate(last.items(), start=1):
            history = History(records, index, HistorySpec())
            for sender, count in ((s, n) for s in SENDERS for n in FRAMES):
                frame = history.of(SENDERS[sender], count)
                key = jax.random.fold_in(jax.random.key(0), index)
                title = f"{sender}, {count} frame{'s' if count > 1 else ''}"
                for method, points in _clouds(key, frame, models):
                    yield (
                        {
                            "scene": title,
                            "sequence": name,
                            "frame": frame.frame,
                            "truth": "LiDAR",
                            "method": method,
                            "points": len(points),
                            "truth_points": len(frame.lidar_xyz),
                            "milliseconds": float("nan"),
                        },
                        points,
                        np.asarray(frame.lidar_xyz),
                    )
            show(number)


def _clouds(key, frame, models):
    """Yield each method and its points, those of models with their confidence."""
    view = next(iter(models.values())).spec.frame_grid.view
    own = points_of(frame.radar)
    yield "radar points", own[in_view(own, view)]
    yield "splat", points_of(smeared(key, frame.radar, view))
    for name, model in models.items():
        (pair,) = pairs_of(model.spec, [frame])
        yield name, surest_points(drawn(model)(key, MethodInput(frame, pair)))


def _by(what, scores):
    """Return mean F-scores in percent: a row for each scene and kind or ring."""
    found = {}
    for row, where, score in scores:
        cells = found.setdefault((row["scene"], where), {})
        cells.setdefault(row["method"], []).append(score)
    methods = [*next(iter(found.values()))]
    return markdown_table(
        ("points", what, *methods),
        (
            (*where, *(f"{100 * np.nanmean(cells[method]):.1f}" for method in methods))
            for where, cells in found.items()
            if np.isfinite(cells[methods[0]]).any()
        ),
    )


def _confidences(judged):
    """Return how right confidences are: a row for each scene and model, in percent."""
    rows = []
    for where, parts in judged.items():
        confidence, right = map(np.concatenate, parts)
        error = reliability(confidence, right).error()
        shares = confidence.mean(dtype=float), right.mean(), error
        rows.append((*where, *(f"{100 * share:.1f}" for share in shares)))
    titles = "points", "model", "confidence (%)", "right (%)", "calibration error (%)"
    return markdown_table(titles, rows)


if __name__ == "__main__":
    sys.exit(main())
