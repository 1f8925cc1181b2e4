r"""Score models and CFAR detectors on the robustness set: one row for each shift.

    python -m experiments.studies.robustness -o runs/robustness \
        --rates runs/regression/data/records --model jradar-sim

The set has the same layouts under each shift: another board, another mount, clutter,
interference, a kind of scene that no model was trained on. Detectors have the
false-alarm rates that are best on the validation split of `--rates`. The shifts are
simulated and prepared below the output, with interference removed; an interrupted study
resumes.

`evaluation/shifts.md` has a row for each shift and a column for each method, with 95 %
intervals over layouts. A method is judged by its mean over the shifts; the clean row is
the unit without a shift. Where a model knows what training looked like, the last
columns say how many frames it warns of, and the area under the ROC curve of its
warning between clean and shifted frames.
"""

import itertools
import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Float
from scipy.stats import mannwhitneyu

from experiments.build import build_pairs, prepare_spec
from experiments.command import run_study, study_parser
from experiments.configs import default, varied
from experiments.detectors import choose_rates, detector_methods
from experiments.evaluate import score_records, view_of
from experiments.tables import markdown_table
from experiments.tasks.enhance import model_methods
from jradar import data, evaluation
from jradar.errors import UsageError
from jradar.files import write_text
from jradar.model import Model, load_model
from jradar.progress import progress
from jradar.range_image import STRANGE, training_distance, unlikeness
from jradar.simulation import SHIFTS, set_sequences, simulate_set

KEY = 20
CLEAN = "clean"


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
    rows, distances = [], {}
    for shift in options.shift or SHIFTS:
        folder = prepared_shift(options.output / "data" / shift, shift)
        rows += score_shift(folder, shift, models, rates, quick=options.quick)
        for name, model in models.items():
            if model.spec.trust is not None:
                distances[name, shift] = warning(folder, model)
    path = options.output / "evaluation" / "frames.jsonl"
    evaluation.write_scores(path, rows)
    evaluation.write_tables(path)
    table = shifts_table(evaluation.read_scores(path), distances)
    write_text(path.with_name("shifts.md"), table)
    print(table)


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


def warning(folder: Path, model: Model) -> Float[np.ndarray, "frame 2"]:
    """Return each frame's distance from the model's training, and its unlikeness."""
    trust = model.spec.trust
    assert trust is not None
    pairs = build_pairs(model.spec, data.Records(folder, "test"))
    conditions = np.stack([pair.condition for pair in pairs])
    both = training_distance(conditions, trust), unlikeness(conditions, trust)
    return np.stack([*map(np.asarray, both)], -1)


def shifts_table(
    scores: Sequence[dict[str, Any]],
    distances: dict[tuple[str, str], Float[np.ndarray, "frame 2"]],
) -> str:
    """Return Markdown: CD (m) / F-score at 0.2 m (%) of each method under each shift.

    `distances` are those of `warning`, by model and shift.
    """
    truth = scores[0]["truth"]
    first = [row for row in scores if row["truth"] == truth]
    found = {(r["scene"], r["method"]): r for r in evaluation.summarise(first)}
    shifts = [*dict.fromkeys(shift for shift, _ in found)]
    methods = [*dict.fromkeys(method for _, method in found)]
    names = [*dict.fromkeys(name for name, _ in distances)]
    rows = []
    for shift in shifts:
        row = [shift, *(_cell(found[shift, method]) for method in methods)]
        rows.append(row + [_warned(distances, name, shift) for name in names])
    if shifted := [shift for shift in shifts if shift != CLEAN]:
        row = ["**mean over shifts**"]
        for method in methods:
            means = [
                np.nanmean([found[shift, method][score].mean for shift in shifted])
                for score in ("chamfer", "f_score_0.2")
            ]
            row.append(f"**{means[0]:.2f} / {100 * means[1]:.1f}**")
        rows.append(row + ["" for _ in names])
    titles = ["shift", *methods, *(f"warned by {name} (%) / area" for name in names)]
    return markdown_table(titles, rows)


def _cell(row: dict[str, Any]) -> str:
    """Chamfer distance and F-score with half of its interval's width."""
    score = row["f_score_0.2"]
    spread = f" ± {100 * score.half_width:.0f}" if np.isfinite(score.half_width) else ""
    return f"{row['chamfer'].mean:.2f} / {100 * score.mean:.1f}{spread}"


def _warned(distances, name: str, shift: str) -> str:
    """The share of frames with a warning, and the area under the ROC curve."""
    distance, unlike = distances[name, shift].T
    text = f"{100 * (unlike > STRANGE).mean():.0f}"
    if shift == CLEAN or (name, CLEAN) not in distances:
        return text
    clean = distances[name, CLEAN][:, 0]
    pairs = len(clean) * len(distance)
    return f"{text} / {mannwhitneyu(distance, clean).statistic / pairs:.2f}"


if __name__ == "__main__":
    sys.exit(main())
