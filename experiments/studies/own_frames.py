r"""How many frames of one's own does fine-tuning need, and what does it forget?

    python -m experiments.studies.own_frames -o runs/own_frames --frames 20 --frames 50

A rig that training never saw walks through a kind of place that it never saw: an
uncalibrated board, low and tilted down on a badly measured mount, a Livox Mid-360, and
warehouses. The shipped model is fine-tuned on the first walks of it, with and without
replayed old frames, by `jradar.finetuning` with its defaults. `curve.md` has the scores
in other warehouses of the same rig, and on validation layouts of `jradar-sim-4`, which
stand for the old places. An interrupted study resumes.
"""

import sys
from argparse import Namespace
from pathlib import Path
from typing import Any

from experiments.command import run_study, study_parser
from jradar import data
from jradar.errors import UsageError
from jradar.evaluation import markdown_table
from jradar.files import write_text
from jradar.finetuning import FinetuneSpec, finetune
from jradar.scoring import score
from jradar.simulation import set_sequences, simulate_sequence
from jradar.simulation.capture_writer import simulate_capture
from jradar.simulation.sets import UNSEEN
from jradar.simulation.units import FIRST_SHIFT, UnitSpec

START = "jradar-sim"
RIG = UnitSpec(
    board=FIRST_SHIFT + 11,
    calibration_degrees=None,
    mount_degrees=1.5,
    height_m=0.7,
    tilt_degrees=6.0,
    speed_mps=1.0,
    clutter_counts=3.0,
    image_db=-38.0,
    drift_mrad=30.0,
)
WALKS = {901: 20, 902: 30, 903: 25, 904: 25, 905: 50, 906: 50}  # frames, by seed
VALIDATION, TEST = {911: 16}, dict.fromkeys(range(921, 927), 6)
OLD_LAYOUTS = 4  # of each family


def main(argv: list[str] | None = None) -> int:
    """Run the study and return the exit code."""
    parser = study_parser("experiments.studies.own_frames", __doc__)
    text = "own frames to train on: 20, 50, 75, 100, 150 or 200; repeatable"
    parser.add_argument("--frames", type=int, action="append", required=True, help=text)
    parser.add_argument("--seed", type=int, default=0, help="of the training")
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Simulate, fine-tune and score; write the table."""
    root: Path = options.output
    walks = {count: _walks(count) for count in options.frames}
    for seed, count in (VALIDATION | TEST | walks[max(walks)]).items():
        if not (root / "walks" / f"{UNSEEN}_{seed}").is_dir():
            simulate_capture(UNSEEN, seed, root / "walks", frames=count, unit=RIG)
    old, runs, replayed = _old(root / "old"), {}, None
    for replay in (True, False):
        for count, seeds in walks.items():
            records = root / f"records_{count}"
            (check,) = VALIDATION
            data.prepare(
                [root / "walks" / f"{UNSEEN}_{seed}" for seed in (*seeds, check)],
                records,
                data.PrepareSpec(),
                workers=1,
                splits={f"{UNSEEN}_{check}": "validation"},
            )
            kind = FinetuneSpec(seed=options.seed, **({} if replay else {"replay": 0}))
            folder = root / f"{'replay' if replay else 'alone'}_{count}_{options.seed}"
            found = finetune(records, folder, model=START, spec=kind, replay=replayed)
            if replay and replayed is None:
                replayed = folder / "replay" / "records"
            runs[str(folder)] = [count, "yes" if replay else "no", found.steps]
    _report(root, old, runs)


def _walks(frames: int) -> dict[int, int]:
    """Return the first walks, which hold so many frames together."""
    chosen: dict[int, int] = {}
    for seed, count in WALKS.items():
        if sum(chosen.values()) < frames:
            chosen[seed] = count
    if sum(chosen.values()) != frames:
        raise UsageError(f"--frames {frames}: no number of whole walks of {WALKS}")
    return chosen


def _old(root: Path) -> Path:
    """Return records of layouts and units like those of training, each unseen."""
    seeds: dict[str, int] = {}
    for item in set_sequences("jradar-sim-4"):
        number = seeds.setdefault(item.family, 0)
        if item.split != "validation" or number == OLD_LAYOUTS:
            continue
        seeds[item.family] += 1
        if not (root / "recordings" / f"{item.family}_{item.seed}").is_dir():
            simulate_sequence(
                item.family, item.seed, root / "recordings", frames=1, unit=item.unit
            )
    records = root / "records"
    data.prepare(root / "recordings", records, data.PrepareSpec(), workers=1)
    return records


def _report(root: Path, old: Path, runs: dict[str, list[Any]]) -> None:
    """Score the shipped model and those of the runs, and write the table."""
    models = [START, *runs]
    places = [
        score([root / "walks" / f"{UNSEEN}_{s}" for s in TEST], models=models),
        score(old, models=models, split="train"),
    ]
    rows = [["0", "", "", *(_cell(place, START) for place in places), "", ""]]
    for name, about in runs.items():
        cells = [_cell(place, name) for place in places]
        changes = [_change(place, name) for place in places]
        rows.append([*about, *cells, *changes])
    titles = ["own frames", "replay", "steps", "new place", "old places"]
    titles += ["change, new", "change, old"]
    table = markdown_table(titles, rows)
    write_text(
        root / "curve.md", f"F-score at 0.2 m (%), with 95 % intervals\n\n{table}"
    )
    print(table)


def _cell(place: Any, method: str) -> str:
    """Return a method's F-score with its interval."""
    lines = place.describe()["against the LiDAR"]
    line = next(line for line in lines if line["method"] == method)
    title, low, high = (k for k in line if k.startswith("F ") or k in ("from", "to"))
    return f"{line[title]:.1f}" + _ends(f"{line[low]:.1f}–{line[high]:.1f}")


def _change(place: Any, method: str) -> str:
    """Return a method minus the shipped model, with its interval."""
    lines = place.describe()["compared"]
    line = next(line for line in lines if line["methods"].startswith(f"{method} minus"))
    _, mean, low, high, _ = line.values()
    return f"{mean:+.1f}" + _ends(f"{low:+.1f} to {high:+.1f}")


def _ends(text: str) -> str:
    """Return an interval in brackets, nothing for one of too few frames."""
    return "" if "nan" in text else f" ({text})"


if __name__ == "__main__":
    sys.exit(main())
