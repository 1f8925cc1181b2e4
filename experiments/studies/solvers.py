r"""Score a model over the number of network evaluations, for several solvers.

    python -m experiments.studies.solvers runs/default/model RECORDS -o runs/solvers

Scores are of the validation split, because the number of steps is chosen by them.
Heun's method evaluates the network twice in every step but the last, all other solvers
once.
"""

import sys
from argparse import Namespace
from typing import Any

import jax

from experiments.build import build_pairs
from experiments.command import run_study, study_parser
from experiments.evaluate import View, score_records
from experiments.tables import csv_text, curves_figure, mean_rows
from experiments.tasks.enhance import drawn
from jradar import data, evaluation, viz
from jradar.diffusion import SOLVERS, Solver
from jradar.evaluation import Method
from jradar.files import write_text
from jradar.model import Model, load_model

EVALUATIONS = (1, 3, 5, 9, 17, 35)  # 35 are the paper's 18 steps of Heun's method
SHOWN = ("heun", "euler", "ipndm3", "dpm++2m")


def main(argv: list[str] | None = None) -> int:
    """Run the study and return the exit code."""
    parser = study_parser("solvers", __doc__)
    parser.add_argument("model", help="folder of a trained model")
    parser.add_argument("records", help="folder of `jradar prepare`")
    parser.add_argument("--every", type=int, default=10, help="score every n-th frame")
    parser.add_argument("--solvers", nargs="+", choices=SOLVERS, default=SHOWN)
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Score the solvers, and write tables and a figure."""
    model = load_model(options.model)
    records = data.Records(options.records, "validation")
    rows = [
        row
        for row in score_records(
            jax.random.key(0),
            View(model.spec.radar, model.spec.fine),
            records,
            build_pairs(model.spec, records),
            solver_methods(model, tuple(options.solvers)),
            every=options.every,
        )
        if row["truth"] == "LiDAR" and row["truth_points"]
    ]
    out = options.output / "evaluation"
    evaluation.write_scores(out / "frames.jsonl", rows)
    evaluation.write_tables(out / "frames.jsonl")
    scores = ("method", "chamfer", "f_score_0.2", "milliseconds")
    means = mean_rows([{k: row[k] for k in scores} for row in rows], ("method",))
    write_text(out / "solvers.csv", csv_text(means))
    figure = curves_figure(
        curves(means),
        xlabel="evaluations of the network",
        ylabels=["Chamfer distance (m)", "F-score at 0.2 m"],
    )
    viz.save_figure(figure, out / "solvers.png")
    table = evaluation.markdown(evaluation.summarise(rows))
    print(f"{table}\nwritten to {out}")


def steps_of(solver: Solver, evaluations: int) -> int:
    """Return the number of steps with that number of network evaluations."""
    counts = range(1, evaluations + 1)
    return next(steps for steps in counts if solver.evaluations(steps) == evaluations)


def solver_methods(model: Model, solvers: tuple[str, ...]) -> dict[str, Method]:
    """Return a method, "solver evaluations", for each solver and number."""
    return {
        f"{name} {evaluations}": drawn(
            model,
            draws=1,
            solver=SOLVERS[name],
            steps=steps_of(SOLVERS[name], evaluations),
        )
        for name in solvers
        for evaluations in EVALUATIONS
    }


def curves(means: list[dict[str, Any]]) -> dict[str, dict[str, list]]:
    """Return the lines of the figure: each solver's scores over evaluations."""
    panels: dict[str, dict[str, list]] = {"chamfer": {}, "f_score_0.2": {}}
    for row in means:
        solver, evaluations = row["method"].split(" ")
        for score, lines in panels.items():
            lines.setdefault(solver, []).append((int(evaluations), row[score]))
    return panels


if __name__ == "__main__":
    sys.exit(main())
