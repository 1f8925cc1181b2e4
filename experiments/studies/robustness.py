r"""Score models and CFAR detectors on the robustness set: one row for each shift.

    python -m experiments.studies.robustness -o runs/robustness \
        --rates runs/regression/data/records --model jradar-sim

The set has the same layouts under each shift: another board, another mount, clutter,
interference, a kind of scene that no model was trained on. Detectors have the
false-alarm rates that are best on the validation split of `--rates`. The shifts are
simulated and prepared below the output, with interference removed; an interrupted study
resumes.

The table `evaluation/table.md` has a row for each method and shift, with intervals over
layouts. A method is judged by its mean over the shifts, the clean row stands beside it.
"""

import itertools
import sys
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax

from experiments.build import build_pairs, prepare_spec
from experiments.command import run_study, study_parser
from experiments.configs import default, varied
from experiments.detectors import choose_rates, detector_methods
from experiments.evaluate import score_records, view_of
from experiments.tasks.enhance import model_methods
from jradar import data, evaluation
from jradar.errors import UsageError
from jradar.model import Model, load_model
from jradar.progress import progress
from jradar.simulation import SHIFTS, set_sequences, simulate_set

KEY = 20


def main(argv: list[str] | None = None) -> int:
    """Run the study and return the exit code."""
    parser = study_parser("robustness", __doc__)
    parser.add_argument(
        "--rates", required=True, help="records whose validation split sets the rates"
    )
    parser.add_argument(
        "--model", action="append", default=[], help="shipped model, or a folder"
    )
    parser.add_argument(
        "--shift", action="append", choices=[*SHIFTS], help="only this shift"
    )
    text = "score only what several draws agree on, beside the detector"
    parser.add_argument("--quick", action="store_true", help=text)
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Simulate and prepare the shifts, score all methods, and write the tables."""
    models = {name: load_model(name) for name in options.model}
    chosen = data.Records(options.rates, "validation")
    rates = choose_rates(view_of(chosen), chosen, detectors=("os",))
    print(f"false-alarm rates: {rates}")
    rows = []
    for shift in options.shift or SHIFTS:
        folder = prepared_shift(options.output / "data" / shift, shift)
        rows += score_shift(folder, shift, models, rates, quick=options.quick)
    path = options.output / "evaluation" / "frames.jsonl"
    evaluation.write_scores(path, rows)
    evaluation.write_tables(path)
    print(evaluation.overview(evaluation.read_scores(path)))


def prepared_shift(folder: Path, shift: str) -> Path:
    """Return the records of a shift, simulated and prepared if they are missing."""
    name, records = f"jradar-sim-2-robust/{shift}", folder / "records"
    total, done = len(set_sequences(name)), itertools.count(1)
    with progress(f"simulating {shift}", total, unit="frames") as show:
        simulate_set(name, folder / "recordings", advance=lambda: show(next(done)))
    spec = prepare_spec(varied.get_config())
    data.prepare(folder / "recordings", records, spec, workers=1)
    return records


def score_shift(
    folder: Path,
    shift: str,
    models: dict[str, Model],
    rates: dict[str, float],
    *,
    quick: bool = False,
) -> Iterator[dict[str, Any]]:
    """Yield the rows of one shift, which stands in the column of the scene."""
    records = data.Records(folder, "test")
    view, config = view_of(records), default.get_config()
    methods = detector_methods(view, rates)
    pairs, grids = None, set()
    for name, model in models.items():
        grids.add((model.spec.coarse, model.spec.fine, model.spec.num_slices))
        if len(grids) > 1:
            raise UsageError(f"--model {name} has other images than the first model")
        pairs = build_pairs(model.spec, records)
        prefix = f"{name}: " if len(models) > 1 else ""
        found = [*model_methods(config, model).items()]
        methods |= {prefix + row: method for row, method in found[-1 if quick else 0 :]}
    if pairs is None:
        pairs = data.PairSource(records, view.fine, view.fine, num_slices=1)
    key = jax.random.key(KEY)
    for row in score_records(key, view, records, pairs, methods):
        yield row | {"scene": shift, "sequence": f"{shift} {row['sequence']}"}


if __name__ == "__main__":
    sys.exit(main())
