r"""What are models worth on the points of a chip and of a capture card, in histories?

    python -m experiments.places --set=jradar-sim-6 --maps=ColoRadar -o runs/sim6
    python -m experiments.studies.histories runs/sim6 -o runs/compared

The last frame of each walk (`jradar-sim-6`) is asked, with the points of 1 and of 10
frames: all weak cells, as a capture card gives them, and what TI's chip sends (CASO,
peaks grouped, the 120 strongest, rounded). Rows are the points themselves, `splat`,
which smears them, and the models, which all get the same points.
"""

import sys
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path

import jax

from experiments.command import run_study, study_parser
from jradar import load_model
from jradar.data import Records, pairs_of
from jradar.data.histories import History, HistorySpec, Sender
from jradar.evaluation import (
    MethodInput,
    drawn,
    in_view,
    points_of,
    score_points,
    smeared,
    write_scores,
    write_tables,
)
from jradar.model import Model
from jradar.progress import progress
from jradar.radar import PointSpec

CASO = PointSpec(detector="so", false_alarm_rate=1e-3, group_peaks=True)
SENDERS = {"card": Sender(), "chip": Sender(CASO, most=120, step_m=1 / 128)}
FRAMES = (1, 10)


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
    rows = list(scores(records, models))
    write_scores(options.output / "frames.jsonl", rows)
    write_tables(options.output / "frames.jsonl")


def scores(records: Records, models: dict[str, Model]) -> Iterator[dict]:
    """Yield a row for each walk, kind of points, number of frames and method."""
    last = {name: index for index, (name, _) in enumerate(records.where)}
    with progress("walks", len(last)) as show:
        for number, (name, index) in enumerate(last.items(), start=1):
            history = History(records, index, HistorySpec())
            for sender, count in ((s, n) for s in SENDERS for n in FRAMES):
                frame = history.of(SENDERS[sender], count)
                key = jax.random.fold_in(jax.random.key(0), index)
                title = f"{sender}, {count} frame{'s' if count > 1 else ''}"
                for method, xyz in _clouds(key, frame, models):
                    yield {
                        "scene": title,
                        "sequence": name,
                        "frame": frame.frame,
                        "truth": "LiDAR",
                        "method": method,
                        "points": len(xyz),
                        "truth_points": len(frame.lidar_xyz),
                        "milliseconds": float("nan"),
                        **score_points(xyz, frame.lidar_xyz),
                    }
            show(number)


def _clouds(key, frame, models):
    """Yield each method and its points."""
    view = next(iter(models.values())).spec.frame_grid.view
    own = points_of(frame.radar)
    yield "radar points", own[in_view(own, view)]
    yield "splat", points_of(smeared(key, frame.radar, view))
    for name, model in models.items():
        (pair,) = pairs_of(model.spec, [frame])
        yield name, points_of(drawn(model)(key, MethodInput(frame, pair)))


if __name__ == "__main__":
    sys.exit(main())
