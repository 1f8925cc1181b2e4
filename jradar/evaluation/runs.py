"""Several runs side by side: merged scores, and tests of their differences."""

import functools
import statistics
from collections.abc import Sequence
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Array, Key

from jradar.evaluation.scores import Scores, read_scores
from jradar.evaluation.statistics import compare_methods
from jradar.evaluation.tables import COLUMNS, IN_SCENES as COMPARED, markdown_table

TITLES = ("95 % interval", "p, t-test", "p, sign flips", "frames", "left out")


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


def seeds_table(runs: Sequence[Path | str]) -> str:
    """Return each method's mean scores over runs, and their deviation from run to run.

    Scores are against the first truth, and scenes are pooled.
    """
    means: dict[str, dict[str, list[float]]] = {}
    for run in runs:
        scores = read_scores(Path(run) / "evaluation" / "frames.jsonl")
        for method, rows in _by_method(scores, scores[0]["truth"]).items():
            found = means.setdefault(method, {})
            for score in COMPARED:
                values = [row[score] for row in rows if row["truth_points"]]
                found.setdefault(score, []).append(float(np.nanmean(values)))
    lines = [
        [method, *(_spread(found[score], score) for score in COMPARED), len(runs)]
        for method, found in means.items()
    ]
    titles = [COLUMNS[score].title for score in COMPARED]
    return markdown_table(["method", *titles, "runs"], lines)


def _spread(means: list[float], score: str) -> str:
    """Return a mean over runs with its deviation, as printed."""
    text = COLUMNS[score].text
    return f"{text(statistics.mean(means))} ± {text(statistics.stdev(means))}"


def comparison_table(
    key: Key[Array, ""], scores: Scores, *, reference: str, score: str = "chamfer"
) -> str:
    """Return each method minus `reference` on the same frames, as a Markdown table.

    Scores are against the first truth, and scenes are pooled. Columns are the
    difference, its 95 % interval and both p-values of `compare_paired`. Raises
    ValueError if no method is called `reference`.
    """
    against = scores[0]["truth"]
    by_method = _by_method(scores, against)
    if reference not in by_method:
        raise ValueError(
            f"{reference=}, expected one of {[*by_method]} against {against!r}"
        )
    lines = [
        [method, *_cells(jax.random.fold_in(key, i), rows, by_method[reference], score)]
        for i, (method, rows) in enumerate(by_method.items())
        if method != reference
    ]
    title = f"{COLUMNS[score].title}, minus {reference}"
    return markdown_table([title, "difference", *TITLES], lines)


def runs_table(key: Key[Array, ""], first: Scores, second: Scores) -> str:
    """Return the second run minus the first, frame by frame, as a Markdown table.

    It has a line for each method and score, and the columns of `comparison_table`.
    Methods with equal scores in both runs are only named. Raises ValueError if the runs
    have no method in common.
    """
    against = first[0]["truth"]
    sides = [_by_method(scores, against) for scores in (first, second)]
    common = [method for method in sides[0] if method in sides[1]]
    if not common:
        raise ValueError(
            f"no method in common against {against!r}: {[*sides[0]]} and {[*sides[1]]}"
        )
    lines, same = [], []
    for i, method in enumerate(common):
        before, after = (side[method] for side in sides)
        if _results(before, method) == _results(after, method):
            same.append(method)
            continue
        own = jax.random.fold_in(key, i)
        lines += [
            [method, COLUMNS[score].title, *_cells(own, after, before, score)]
            for score in COMPARED
        ]
    titles = ["method", "score", "second minus first", *TITLES]
    text = markdown_table(titles, lines)
    return text + (f"\nThe same in both: {', '.join(same)}.\n" if same else "")


def _by_method(scores: Scores, truth: str) -> dict[str, Scores]:
    found: dict[str, Scores] = {}
    for row in scores:
        if row["truth"] == truth:
            found.setdefault(row["method"], []).append(row)
    return found


def _cells(key: Key[Array, ""], rows: Scores, other: Scores, score: str) -> list[str]:
    """Return the difference of two methods' rows, its interval, tests and frames."""
    found = compare_methods(key, rows, other, score=score)
    text = functools.partial(COLUMNS[score].text, sign="+")
    mean, low, high = map(text, found.difference[:3])
    interval = f"{low} .. {high}" if np.isfinite(found.difference.low) else "–"
    cells = [mean, interval, f"{found.t_test:.2g}", f"{found.sign_flip:.2g}"]
    return [*cells, str(found.difference.frames), str(found.left_out)]


def _results(scores, method):
    """Return a method's scores without times, as texts, so that NaN equals NaN."""
    return tuple(
        repr([value for field, value in row.items() if field != "milliseconds"])
        for row in scores
        if row["method"] == method
    )
