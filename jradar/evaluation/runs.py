"""Several runs side by side: merged scores, and tests of their differences."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import jax
from jaxtyping import Array, Key

from jradar.evaluation.scores import IDENTITY, Scores, read_scores
from jradar.evaluation.statistics import Comparison, compare_methods
from jradar.evaluation.tables import COLUMNS, format_score

COMPARED = ("chamfer", "modified_hausdorff", "f_score_0.2")


def read_runs(runs: Sequence[Path | str]) -> Scores:
    """Return the scores of several runs, with methods named "method (run)".

    A method keeps its name if only one run scored it, or if its scores are the same in
    all runs: a baseline on the same frames, for example.
    """
    found = {}
    for run in map(Path, runs):
        name = run.resolve().name
        if name in found:
            raise ValueError(
                f"two runs are called {name}: {[str(r) for r in runs]}; rename one"
            )
        found[name] = read_scores(run / "evaluation" / "frames.jsonl")
    versions: dict[str, set] = {}
    for scores in found.values():
        for method in {row["method"] for row in scores}:
            versions.setdefault(method, set()).add(_results(scores, method))
    merged: Scores = []
    shared: set[str] = set()  # methods of earlier runs
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
    """Return each method minus `reference` on the same frames, as a Markdown table.

    Scenes are pooled. Columns are the difference, its 95 % interval and both p-values
    of `compare_paired`. `truth` is by default the first one. Raises ValueError if no
    method is called `reference`.
    """
    against = truth or str(scores[0]["truth"])
    by_method = _by_method(scores, against)
    if reference not in by_method:
        raise ValueError(
            f"{reference=}, expected one of {[*by_method]} against {against!r}"
        )
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


def runs_table(
    key: Key[Array, ""], first: Scores, second: Scores, *, truth: str | None = None
) -> str:
    """Return the second run minus the first, frame by frame, as a Markdown table.

    It has a line for each method and score, and the columns of `comparison_table`.
    Methods with equal scores in both runs are only named. Raises ValueError if the runs
    have no method in common.
    """
    against = truth or str(first[0]["truth"])
    sides = [_by_method(scores, against) for scores in (first, second)]
    common = [method for method in sides[0] if method in sides[1]]
    if not common:
        raise ValueError(
            f"no method in common against {against!r}: {[*sides[0]]} and {[*sides[1]]}"
        )
    lines = [
        "| method | score | second minus first | 95 % interval | p, t-test "
        "| p, sign flips | frames | left out |",
        "|---" * 8 + "|",
    ]
    same = []
    for i, method in enumerate(common):
        rows = [side[method] for side in sides]
        if _results(rows[0], method) == _results(rows[1], method):
            same.append(method)
            continue
        for score in COMPARED:
            found = compare_methods(
                jax.random.fold_in(key, i), rows[1], rows[0], score=score
            )
            lines.append(f"| {method} | {COLUMNS[score]} | {_cells(found, score)} |")
    text = "\n".join(lines) + "\n"
    return text + (f"\nThe same in both: {', '.join(same)}.\n" if same else "")


def frames_csv(first: Scores, second: Scores) -> str:
    """Return every frame's scores in both runs and their difference, as CSV."""
    found = {tuple(row[f] for f in IDENTITY): row for row in first}
    text = io.StringIO()
    write = csv.writer(text, lineterminator="\n").writerow
    parts = ("first", "second", "difference")
    write([*IDENTITY, *(f"{score} {part}" for score in COMPARED for part in parts)])
    for row in second:
        place = tuple(row[f] for f in IDENTITY)
        if (before := found.get(place)) is not None:
            pairs = [(before[score], row[score]) for score in COMPARED]
            numbers = [x for a, b in pairs for x in (a, b, b - a)]
            write([*place, *(f"{x:.6g}" if x == x else "" for x in numbers)])
    return text.getvalue()


def _by_method(scores: Scores, truth: str) -> dict[str, Scores]:
    found: dict[str, Scores] = {}
    for row in scores:
        if row["truth"] == truth:
            found.setdefault(row["method"], []).append(row)
    return found


def _cells(found: Comparison, score: str) -> str:
    mean, low, high = (format_score(x, score, sign="+") for x in found.difference[:3])
    cells = [mean, f"{low} .. {high}", f"{found.t_test:.2g}", f"{found.sign_flip:.2g}"]
    return " | ".join([*cells, str(found.difference.frames), str(found.left_out)])


def _results(scores, method):
    """Return a method's scores without times, as texts, so that NaN equals NaN."""
    return tuple(
        repr([value for field, value in row.items() if field != "milliseconds"])
        for row in scores
        if row["method"] == method
    )
