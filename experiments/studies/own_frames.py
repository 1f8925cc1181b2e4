r"""How many frames of one's own does fine-tuning need, and what does it forget?

    python -m experiments.studies.own_frames --rig warehouse -o runs/warehouse \
        --frames 20 --frames 50 --seed 0 --seed 1 --compare

A rig that training never saw walks through a kind of place that it never saw, with a
Livox Mid-360. The shipped model is fine-tuned on the first walks of it by
`jradar.training.finetune` with its defaults, once for each seed. With `--compare`, the
first seed is also trained without old frames, however much it forgets. `curve.md` has
the scores in other places of the same kind, and on validation frames of
`jradar-sim-5-mini`, which stand for the old places: means over the seeds, with 95 %
intervals over frames. An interrupted study resumes.
"""

import itertools
import sys
from argparse import Namespace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from experiments.command import run_study, study_parser
from jradar import data
from jradar.errors import UsageError
from jradar.evaluation import compare_methods, markdown_table, pooled
from jradar.evaluation.records import TRUTH
from jradar.files import write_text
from jradar.scoring import JUDGED, Score, score
from jradar.simulation import drawn_sources
from jradar.simulation.capture_writer import simulate_capture
from jradar.simulation.units import FIRST_SHIFT, UnitSpec
from jradar.training import FinetuneSpec, finetune
from jradar.training.replay import simulate_replay

START = "jradar-sim"


class Rig(NamedTuple):
    """A radar unit with its mount, and the kind of places that it is in."""

    family: str
    unit: UnitSpec


RIGS = {
    "warehouse": Rig(
        "warehouse",
        UnitSpec(
            board=FIRST_SHIFT + 11,
            calibration_degrees=None,
            mount_degrees=1.5,
            height_m=0.7,
            tilt_degrees=6.0,
            speed_mps=1.0,
            clutter_counts=3.0,
            image_db=-38.0,
            drift_mrad=30.0,
        ),
    ),
    "plantroom": Rig(  # TI's indoor chirps, which training never saw
        "plantroom",
        UnitSpec(
            board=FIRST_SHIFT + 12,
            calibration_degrees=None,
            mount_degrees=1.0,
            height_m=1.6,
            tilt_degrees=-3.0,
            speed_mps=0.6,
            clutter_counts=6.0,
            noise_db=3.0,
            edge_db=6.0,
            waveform="ti-3d",
        ),
    ),
}
# Frames of the walks to train on, by seed; those of one walk resemble each other.
WALKS = {901: 20, 902: 30, 903: 50, 904: 50, 905: 50, 906: 100, 907: 100}
VALIDATION, TEST = {911: 12, 912: 12}, dict.fromkeys(range(921, 929), 5)
PERIOD_S = 0.5
WAYS: dict[str, dict[str, Any]] = {  # the first is the default
    "default": {},
    "no replay": {"replay": 0.0, "forget": 100.0},
}
OLD, OLD_FRAMES = "jradar-sim-5-mini", slice(0, None, 4)  # of each kind


class Run(NamedTuple):
    """Trainings that differ in their seed alone."""

    frames: int
    way: str
    steps: int
    models: list[str]


def main(argv: list[str] | None = None) -> int:
    """Run the study and return the exit code."""
    parser = study_parser("experiments.studies.own_frames", __doc__)
    parser.add_argument("--rig", choices=RIGS, default="warehouse")
    counts = [*itertools.accumulate(WALKS.values())]
    text = f"own frames to train on, one of {counts}; repeatable"
    parser.add_argument("--frames", type=int, action="append", required=True, help=text)
    text = "of a training; repeatable (default: 0)"
    parser.add_argument("--seed", type=int, action="append", help=text)
    text = "also train in other ways, with the first seed"
    parser.add_argument("--compare", action="store_true", help=text)
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Simulate, fine-tune and score; write the table."""
    root: Path = options.output
    seeds, (family, unit) = options.seed or [0], RIGS[options.rig]
    walks = {count: walks_for(count) for count in options.frames}
    recorded = VALIDATION | TEST | {seed: WALKS[seed] for seed in walks[max(walks)]}
    for seed, count in recorded.items():
        if not (root / "walks" / f"{family}_{seed}").is_dir():
            simulate_capture(
                family,
                seed,
                root / "walks",
                frames=count,
                period_s=PERIOD_S,
                unit=unit,
            )
    runs: list[Run] = []
    for count, chosen in walks.items():
        records = root / f"records_{count}"
        data.prepare(
            [root / "walks" / f"{family}_{seed}" for seed in (*chosen, *VALIDATION)],
            records,
            data.PrepareSpec(),
            workers=1,
            splits={f"{family}_{seed}": "validation" for seed in VALIDATION},
        )
        old = simulate_replay(root / "replay", data.Records(records))
        for way, changes in WAYS.items() if options.compare else [*WAYS.items()][:1]:
            run = Run(count, way, FinetuneSpec().steps_for(count), [])
            for seed in seeds[:1] if changes else seeds:
                folder = root / f"{way.replace(' ', '_')}_{count}_{seed}"
                spec = FinetuneSpec(seed=seed, **changes)
                if not (folder / "model").exists():
                    finetune(records, folder, model=START, spec=spec, replay=old)
                run.models.append(str(folder))
            runs.append(run)
    models = [START, *(model for run in runs for model in run.models)]
    new = [root / "walks" / f"{family}_{seed}" for seed in TEST]
    report(
        root / "curve.md",
        {
            "new place": score(new, models=models),
            "old places": score(_old(root / "old"), models=models, split="validation"),
        },
        runs,
    )


def walks_for(frames: int) -> list[int]:
    """Return the seeds of the first walks, which hold so many frames together."""
    chosen: list[int] = []
    for seed, count in WALKS.items():
        if frames > 0:
            chosen.append(seed)
            frames -= count
    if frames or not chosen:
        counts = [*itertools.accumulate(WALKS.values())]
        raise UsageError(
            f"--frames: expected one of {counts}, the frames of whole walks"
        )
    return chosen


def _old(records: Path) -> Path:
    """Return records of layouts and units like those of training, each unseen."""
    places = [s for s in drawn_sources(OLD) if s.split == "validation"]
    spec = data.PrepareSpec()
    data.prepare_sources(places, records, spec, frames=OLD_FRAMES, workers=1)
    return records


def report(path: Path, places: dict[str, Score], runs: list[Run]) -> None:
    """Write the table of the shipped model and of each run, by place."""
    titles = ["own frames", "way", "steps"]
    titles += [*places, *(f"change, {place}" for place in places)]
    started = [_interval(_mean(place, [START])) for place in places.values()]
    rows: list[list[Any]] = [[0, "", "", *started, *("" for _ in places)]]
    for run in runs:
        means = [_mean(place, run.models) for place in places.values()]
        changes = [
            compare_methods(mean, _mean(place, [START]), score=JUDGED).difference
            for mean, place in zip(means, places.values(), strict=True)
        ]
        rows.append(
            [run.frames, run.way, run.steps]
            + [_interval(mean) for mean in means]
            + [_signed(change) for change in changes]
        )
    table = markdown_table(titles, rows)
    write_text(path, f"F-score at 0.2 m (%), with 95 % intervals\n\n{table}")
    print(table)


def _mean(place: Score, models: list[str]) -> list[dict[str, Any]]:
    """Return the rows of the first model, with the mean scores of all of them."""
    first, *others = (
        [r for r in place.rows if r["method"] == name and r["truth"] == TRUTH]
        for name in models
    )
    return [
        row | {JUDGED: float(np.mean([same[JUDGED] for same in (row, *more)]))}
        for row, *more in zip(first, *others, strict=True)
    ]


def _interval(rows: list[dict[str, Any]]) -> str:
    (mean,) = pooled(rows, columns=(JUDGED,))
    return _ends(mean[JUDGED], "{:.1f}", "–")


def _signed(change: Any) -> str:
    return _ends(change, "{:+.1f}", " to ")


def _ends(estimate: Any, form: str, to: str) -> str:
    """Return a mean in percent with its interval, unless of too few frames."""
    mean, low, high = (form.format(100 * value) for value in estimate[:3])
    return mean if "nan" in low else f"{mean} ({low}{to}{high})"


if __name__ == "__main__":
    sys.exit(main())
