"""Several runs side by side: their scores as one list, and who differs from whom."""

from collections.abc import Sequence
from pathlib import Path

import jax
from jaxtyping import Array, Key

from jradar.evaluation.scores import F_SCORES, Scores, read_scores
from jradar.evaluation.statistics import Comparison, compare_methods
from jradar.evaluation.tables import COLUMNS


def read_runs(runs: Sequence[Path | str]) -> Scores:
    """Scores of several runs' folders; rows of a run's method are named after both.

    A method that only one run has keeps its own name, as does one that scored exactly
    the same in all: a baseline on the same frames.
    """
    found = {}
    for run in map(Path, runs):
        name = run.resolve().name
        if name in found:
            raise ValueError(f"two runs are called {name}: {[str(r) for r in runs]}")
        found[name] = read_scores(run / "evaluation" / "frames.jsonl")
    versions: dict[str, set] = {}
    for scores in found.values():
        for method in {row["method"] for row in scores}:
            versions.setdefault(method, set()).add(_results(scores, method))
    merged: Scores = []
    shared: set[str] = set()  # methods that are in already
    for run, scores in found.items():
        for row in scores:
            method = row["method"]
            if len(versions[method]) > 1:
                merged.append(row | {"method": f"{method} ({run})"})
            elif method not in shared:
                merged.append(row)
        shared |= {row["method"] for row in scores}
    return merged


def comparison_table(
    key: Key[Array, ""],
    scores: Scores,
    *,
    reference: str,
    score: str = "chamfer",
    truth: str | None = None,
) -> str:
    """Each method minus `reference` on the same frames, in Markdown, scenes pooled.

    With the 95 % interval and both p-values of `compare_paired`; `truth` is the first
    one unless named. Raises ValueError where nothing is called `reference`.
    """
    truth = truth or scores[0]["truth"]
    by_method: dict[str, Scores] = {}
    for row in scores:
        if row["truth"] == truth:
            by_method.setdefault(row["method"], []).append(row)
    if reference not in by_method:
        raise ValueError(f"{reference=} is none of {[*by_method]} against {truth!r}")
    lines = [
        f"| {COLUMNS[score]}, minus {reference} | difference | 95 % interval "
        "| p, t-test | p, sign flips | frames | left out |",
        "|---" * 7 + "|",
    ]
    for i, (method, rows) in enumerate(by_method.items()):
        if method != reference:
            found = compare_methods(
                jax.random.fold_in(key, i), rows, by_method[reference], score=score
            )
            lines.append(f"| {method} | {_cells(found, score)} |")
    return "\n".join(lines) + "\n"


def _cells(found: Comparison, score: str) -> str:
    """A comparison as cells of a line."""
    scale, digits = (100, 1) if score in F_SCORES else (1, 3)
    mean, low, high = (f"{scale * x:+.{digits}f}" for x in found.difference[:3])
    cells = [mean, f"{low} .. {high}", f"{found.t_test:.2g}", f"{found.sign_flip:.2g}"]
    return " | ".join([*cells, str(found.difference.frames), str(found.left_out)])


def _results(scores, method):
    """What a method scored, times aside, as something to compare; NaN equals NaN."""
    return tuple(
        repr([value for field, value in row.items() if field != "milliseconds"])
        for row in scores
        if row["method"] == method
    )
