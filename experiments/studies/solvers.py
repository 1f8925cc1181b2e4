r"""How good is a trained model for how many evaluations of its network, by solver.

    python -m experiments.studies.solvers runs/default/bundle RECORDS -o runs/solvers

Scores are those of the validation split, since the number of steps is chosen by them.
Heun's method evaluates the network twice in every step but the last; all others once.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

import jax

from experiments.build import build_pairs
from experiments.studies.detectors import Method, View, score_records
from experiments.studies.projection import csv_text, curves_figure, mean_rows
from experiments.tasks.enhance import sampled
from jradar import data, evaluation, viz
from jradar.bundle import Bundle, load_bundle
from jradar.diffusion import SOLVERS
from jradar.files import write_text

EVALUATIONS = (1, 3, 5, 9, 17, 35)  # 35 are the paper's 18 steps of Heun's method
SHOWN = ("heun", "euler", "ipndm3", "dpm++2m")


def steps_of(solver: str, evaluations: int) -> int:
    """Steps that take so many evaluations, an odd number for Heun's method."""
    return (evaluations + 1) // 2 if solver == "heun" else evaluations


def solver_methods(bundle: Bundle, solvers: tuple[str, ...]) -> dict[str, Method]:
    """A method for each solver and number of evaluations, `solver evaluations`."""
    return {
        f"{solver} {evaluations}": sampled(
            bundle,
            solver=solver,
            steps=steps_of(solver, evaluations),
            **bundle.spec.sampling,
        )
        for solver in solvers
        for evaluations in EVALUATIONS
    }


def curves(means: list[dict[str, Any]]) -> dict[str, dict[str, list]]:
    """Lines of the figure: each solver's scores over evaluations."""
    panels: dict[str, dict[str, list]] = {"chamfer": {}, "f_score_0.2": {}}
    for row in means:
        solver, evaluations = row["method"].split(" ")
        for score, lines in panels.items():
            lines.setdefault(solver, []).append((int(evaluations), row[score]))
    return panels


def main(argv: list[str] | None = None) -> int:
    """Score the solvers on a folder of records; tables and a figure."""
    parser = argparse.ArgumentParser(
        prog="experiments.studies.solvers", description=__doc__
    )
    parser.add_argument("bundle", help="folder of a trained model")
    parser.add_argument("records", help="folder of `jradar prepare`")
    parser.add_argument("-o", "--output", required=True, help="folder for the tables")
    parser.add_argument("--every", type=int, default=10, help="of how many frames one")
    parser.add_argument("--solvers", nargs="+", choices=SOLVERS, default=SHOWN)
    options = parser.parse_args(argv)
    bundle = load_bundle(options.bundle)
    records = data.Records(options.records, "validation")
    rows = [
        row
        for row in score_records(
            jax.random.key(0),
            View(bundle.spec.radar, bundle.spec.fine),
            records,
            build_pairs(bundle.spec, records),
            solver_methods(bundle, tuple(options.solvers)),
            every=options.every,
        )
        if row["truth"] == "LiDAR" and row["truth_points"]
    ]
    path = Path(options.output) / "evaluation" / "frames.jsonl"
    evaluation.write_scores(path, rows)
    evaluation.write_tables(path)
    scores = ("method", "chamfer", "f_score_0.2", "milliseconds")
    means = mean_rows([{k: row[k] for k in scores} for row in rows], ("method",))
    write_text(path.parent / "solvers.csv", csv_text(means))
    figure = curves_figure(
        curves(means),
        xlabel="evaluations of the network",
        ylabels=["Chamfer distance (m)", "F-score at 0.2 m"],
    )
    viz.save_figure(figure, path.parent / "solvers.png")
    table = evaluation.markdown(evaluation.summarise(rows))
    print(f"{table}\nwritten to {path.parent}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
