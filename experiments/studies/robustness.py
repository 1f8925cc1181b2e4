r"""Score models and CFAR detectors on the robustness set: one row for each shift.

    python -m experiments.studies.robustness -o runs/robustness \
        --rates runs/regression/data/records --model jradar-sim

The set has the same layouts under each shift: another board, another mount, clutter,
interference, a kind of scene that no model was trained on. Detectors have the
false-alarm rates that are best on the validation split of `--rates`. The shifts are
simulated and prepared below the output, with interference removed; an interrupted study
resumes. The shifts `ground-and-bounces`, `ti-indoor-waveform` and `clipping` are scored
only where `--shift` asks for them: the mean is over the others.

`evaluation/shifts.md` has a row for each shift and a column for each method, with 95 %
intervals over layouts. The clean row is the unit without a shift. The last columns say
of how many frames a model warns because their radar points look unlike training, and of
how many because their mean confidence is low.
"""

import math
import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from experiments import rpdnet
from experiments.build import prepare_spec, simulate
from experiments.command import run_study, study_parser
from experiments.configs import default, varied
from experiments.enhance import model_methods
from jradar import data, evaluation
from jradar.errors import UsageError
from jradar.evaluation import (
    Method,
    RecordsInView,
    choose_rates,
    detector_methods,
    markdown_table,
    records_in_view,
    score_records,
)
from jradar.files import write_text
from jradar.model import Model, load_model
from jradar.range_image import STRANGE, UNSURE, condition_features, unlikeness
from jradar.simulation.sets import ROBUST
from jradar.simulation.units import SHIFTS

KEY = 20
CLEAN = "clean"
Place = tuple[str, int]  # sequence and frame
Confidences = dict[str, dict[Place, float]]  # mean of each frame, by model


def main(argv: list[str] | None = None) -> int:
    """Run the study and return the exit code."""
    parser = study_parser("experiments.studies.robustness", __doc__)
    parser.add_argument(
        "--rates", required=True, help="records whose validation split sets the rates"
    )
    parser.add_argument(
        "--model", action="append", default=[], help="shipped model, or a folder"
    )
    parser.add_argument(
        "--shift",
        action="append",
        choices=[*SHIFTS],
        help="only this shift",
    )
    text = "also score the detector of this run of the config rpdnet"
    parser.add_argument("--rpdnet", type=Path, metavar="WORKDIR", help=text)
    text = "score only the agreement of several draws, and the detector"
    parser.add_argument("--quick", action="store_true", help=text)
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Simulate and prepare the shifts, score all methods, and write the tables."""
    models = {name: load_model(name) for name in options.model}
    chosen = data.Records(options.rates, "validation")
    rates = choose_rates(records_in_view(chosen), chosen, detectors=("os",))
    print(f"false-alarm rates: {rates}")
    found = options.rpdnet and rpdnet.detector_of(options.rpdnet, chosen)
    rows, warnings = [], {}
    for shift in options.shift or SHIFTS:
        folder = prepared_shift(options.output / "data" / shift, shift)
        seen: Confidences = {}
        view = records_in_view(data.Records(folder, "test"))
        detectors = detector_methods(view, rates)
        if found:
            detectors["RPDNet"] = rpdnet.method_of(view, *found)
        rows += score_shift(view, shift, models, detectors, seen, quick=options.quick)
        for name, model in models.items():
            if model.tables.trust is not None:
                warnings[name, shift] = warning(folder, model, seen.get(name, {}))
    path = options.output / "evaluation" / "frames.jsonl"
    evaluation.write_scores(path, rows)
    evaluation.write_tables(path)
    table = shifts_table(evaluation.read_scores(path), warnings)
    write_text(path.with_name("shifts.md"), table)
    print(table)


def prepared_shift(folder: Path, shift: str) -> Path:
    """Return the records of a shift, simulated and prepared if they are missing."""
    records = folder / "records"
    simulate(f"{ROBUST}{shift}", folder / "recordings", frames=1)
    spec = prepare_spec(varied.get_config())
    data.prepare(folder / "recordings", records, spec, workers=1)
    return records


def score_shift(
    view: RecordsInView,
    shift: str,
    models: dict[str, Model],
    detectors: dict[str, Method],
    seen: Confidences,
    *,
    quick: bool = False,
) -> Iterator[dict[str, Any]]:
    """Yield the rows of one shift, which stands in the column of the scene.

    The mean confidence of each model's last row is written to `seen`.
    """
    records, config, methods = view.records, default.get_config(), {**detectors}
    pairs, grids = None, set()
    for name, model in models.items():
        grid = model.spec.frame_grid
        grids.add(dataclasses.replace(grid, validity_threshold=0.0))
        if len(grids) > 1:
            raise UsageError(f"--model {name} has other images than the first model")
        pairs = data.pairs_of(model.spec, records)
        prefix = f"{name}: " if len(models) > 1 else ""
        found = model_methods(config, model)
        last = [*found][-1]
        pixels = math.prod(grid.view.shape)
        found[last] = _watched(found[last], pixels, seen.setdefault(name, {}))
        chosen = [last] if quick else [*found]
        methods |= {prefix + row: found[row] for row in chosen}
    if pairs is None:
        pairs = data.PairSource(records, view.fine, view.fine, num_slices=1)
    key = jax.random.key(KEY)
    for row in score_records(key, view, pairs, methods):
        yield row | {"scene": shift, "sequence": f"{shift} {row['sequence']}"}


def _watched(method: Method, pixels: int, seen: dict[Place, float]) -> Method:
    """The method, noting the mean confidence of each frame's image; 0 if empty."""

    def call(key, frame):
        cloud = method(key, frame)
        if cloud.confidence is not None:
            valid = np.asarray(cloud.valid)[:pixels]
            kept = np.asarray(cloud.confidence)[:pixels][valid]
            place = frame.prepared.sequence, frame.prepared.frame
            seen[place] = float(kept.mean()) if len(kept) else 0.0
        return cloud

    return call


def warning(
    folder: Path, model: Model, seen: dict[Place, float]
) -> Float[np.ndarray, "frame 2"]:
    """Return each frame's unlikeness, and its confidence, NaN without one."""
    trust = model.tables.trust
    assert trust is not None
    records = data.Records(folder, "test")
    conditions = np.stack([p.condition for p in data.pairs_of(model.spec, records)])
    confidence = [seen.get(place, np.nan) for place in records.where]
    features = condition_features(jnp.asarray(conditions))
    return np.stack([np.asarray(unlikeness(features, trust)), confidence], -1)


def shifts_table(
    scores: Sequence[dict[str, Any]],
    warnings: dict[tuple[str, str], Float[np.ndarray, "frame 2"]],
) -> str:
    """Return Markdown: CD (m) / F-score at 0.2 m (%) of each method under each shift.

    `warnings` are those of `warning`, by model and shift.
    """
    truth = scores[0]["truth"]
    first = [row for row in scores if row["truth"] == truth]
    found = {(r["scene"], r["method"]): r for r in evaluation.summarise(first)}
    shifts = [*dict.fromkeys(shift for shift, _ in found)]
    methods = [*dict.fromkeys(method for _, method in found)]
    names = [*dict.fromkeys(name for name, _ in warnings)]
    rows = []
    for shift in shifts:
        row = [shift, *(_cell(found[shift, method]) for method in methods)]
        rows.append(row + [_warned(*warnings[name, shift].T) for name in names])
    if shifted := [shift for shift in shifts if shift != CLEAN]:
        row = ["**mean over shifts**"]
        for method in methods:
            means = [
                np.nanmean([found[shift, method][score].mean for shift in shifted])
                for score in ("chamfer", "f_score_0.2")
            ]
            row.append(f"**{means[0]:.2f} / {100 * means[1]:.1f}**")
        rows.append(row + ["" for _ in names])
    warned = (f"{name}: unlike, unsure (%)" for name in names)
    return markdown_table(["shift", *methods, *warned], rows)


def _cell(row: dict[str, Any]) -> str:
    """Chamfer distance and F-score with its interval."""
    score = row["f_score_0.2"]
    ends = f" ({100 * score.low:.0f}–{100 * score.high:.0f})"
    spread = ends if np.isfinite(score.low) else ""
    return f"{row['chamfer'].mean:.2f} / {100 * score.mean:.1f}{spread}"


def _warned(unlike: np.ndarray, confidence: np.ndarray) -> str:
    """The shares of frames with each warning, in percent."""
    shares = (unlike > STRANGE).mean(), (confidence < UNSURE).mean()
    return ", ".join(f"{100 * share:.0f}" for share in shares)


if __name__ == "__main__":
    sys.exit(main())
