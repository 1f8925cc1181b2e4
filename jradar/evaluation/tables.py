"""Tables from scores: every mean with its interval, and the paper's Tables I and II.

Distances are means over the frames in which the method found points. A frame without
points has the F-score 0. The number of such frames is printed next to the means.

`summarise` groups rows, and `markdown` prints the groups. Rows need a `sequence`, a
`frame`, `points`, `truth_points` and some of the scores in `COLUMNS`. `markdown_table`
writes any titles and cells.
"""

import csv
import io
import itertools
import statistics
from collections.abc import Callable, Collection, Iterable, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from jradar.evaluation.scores import DISTANCES, read_scores
from jradar.evaluation.statistics import mean_interval
from jradar.files import write_text

Style = Literal["markdown", "latex"]
Summary = list[dict[str, Any]]


class Column(NamedTuple):
    """How a score is printed, and whether the least or the most is best."""

    title: str
    digits: int = 3
    scale: float = 1.0
    best: Callable = min
    most: float = np.inf  # the largest value that is possible

    def text(self, value: float, *, sign: str = "") -> str:
        """Return a value as printed."""
        return f"{self.scale * value:{sign}.{self.digits}f}"


COLUMNS = {
    "chamfer": Column("CD (m)"),
    "modified_hausdorff": Column("MHD (m)"),
    "f_score_0.1": Column("F 0.1 m (%)", 1, 100.0, max, 1.0),
    "f_score_0.2": Column("F 0.2 m (%)", 1, 100.0, max, 1.0),
    "f_score_0.5": Column("F 0.5 m (%)", 1, 100.0, max, 1.0),
    "points": Column("points", 0, best=max),
    "milliseconds": Column("ms", 1),
}
REPEATED = tuple(COLUMNS)[:-1]  # of the same clouds, on any machine
IN_SCENES = (*DISTANCES, "f_score_0.2")  # of the paper's tables
TABLE_II = ("corridor", "hall")
BOLD = {"markdown": ("**", "**"), "latex": (r"\textbf{", "}")}
DASH = {"markdown": "–", "latex": "--"}
MARK = {"markdown": " †", "latex": r"\textsuperscript{\dag}"}


def summarise(
    scores: Iterable[dict[str, Any]],
    *,
    by: tuple[str, ...] = ("truth", "scene", "method"),
    columns: Sequence[str] = tuple(COLUMNS),
) -> Summary:
    """Return an `Estimate` of every column, a row for each combination of `by`.

    Rows are in order of appearance. `empty` counts frames in which the method found
    nothing; `no_truth` counts frames with an empty truth, which are left out.
    """
    groups: dict[tuple, dict[str, list]] = {}
    for row in scores:
        group = groups.setdefault(tuple(row[name] for name in by), {})
        group.setdefault(row["sequence"], []).append(row)
    summary = []
    for group, sequences in groups.items():
        ordered = [
            [r for r in sorted(rows, key=lambda r: r["frame"]) if r["truth_points"]]
            for rows in sequences.values()
        ]
        rows = [row for sequence in ordered for row in sequence]
        estimates = {
            column: mean_interval(
                [[r[column] for r in s] for s in ordered], most=COLUMNS[column].most
            )
            for column in columns
        }
        counts = {
            "frames": len(rows),
            "empty": sum(not row["points"] for row in rows),
            "no_truth": sum(map(len, sequences.values())) - len(rows),
        }
        names = dict(zip(by, group, strict=True))
        summary.append({**names, **estimates, **counts})
    return summary


def markdown(
    summary: Summary,
    *,
    columns: Collection[str] = REPEATED,
    intervals: bool = False,
) -> str:
    """Return a summary as a Markdown table, F-scores in percent.

    A field by which rows are grouped is a column if it varies; the last always is one.
    `intervals` adds the 95 % interval to each mean.
    """
    *others, last = (name for name in summary[0] if isinstance(summary[0][name], str))
    names = [name for name in others if len({row[name] for row in summary}) > 1]
    names += [last]
    lines = []
    for row in summary:
        cells = _cells(row, columns, intervals=intervals)
        heads = [row[name] for name in names]
        lines.append([*heads, *cells, row["frames"], row["empty"]])
    titles = [COLUMNS[column].title for column in columns]
    return markdown_table([*names, *titles, "frames", "empty"], lines)


def scenes_table(
    summary: Summary,
    *,
    truth: str,
    scenes: Sequence[str],
    style: Style = "markdown",
    intervals: bool = False,
) -> str:
    """Return the paper's table: a row for each method, a column for each scene.

    A cell holds CD (m) / MHD (m) / F-score at 0.2 m (%), the best of each scene in
    bold. `intervals` adds the 95 % intervals. A caption counts the frames in which a
    method found nothing. LaTeX needs booktabs.
    """
    of_truth = [r for r in summary if r["truth"] == truth and r["scene"] in scenes]
    rows = {(r["method"], r["scene"]): r for r in of_truth}

    def cell(method, scene):
        if (row := rows.get((method, scene))) is None:
            return "–"
        alike = [r for r in of_truth if r["scene"] == scene]
        texts = _cells(row, IN_SCENES, alike, style=style, intervals=intervals)
        return " / ".join(texts) + (MARK[style] if row["empty"] else "")

    escape = _latex if style == "latex" else str
    titles = ["method", *map(escape, scenes)]
    methods = dict.fromkeys(row["method"] for row in of_truth)
    lines = [[escape(m), *(cell(m, scene) for scene in scenes)] for m in methods]
    notes = [
        f"{method} found nothing in {row['empty']} of {row['frames']} frames of {scene}"
        for (method, scene), row in rows.items()
        if row["empty"]
    ]
    scores = " / ".join(COLUMNS[score].title for score in IN_SCENES)
    caption = escape(f"{scores} against {truth}.")
    if notes:
        notes = escape(f"{'; '.join(notes)}: no distance, F-score 0.")
        caption += f"{MARK[style]} {notes}"
    if style == "latex":
        return _latex_table(titles, lines, caption)
    return f"{markdown_table(titles, lines)}\n{caption.strip()}\n"


def overview(scores: Sequence[dict[str, Any]]) -> str:
    """Return the tables that a run prints: means of all scenes, then scene by scene.

    Scores are against the first truth.
    """
    truth = scores[0]["truth"]
    rows = [row for row in scores if row["truth"] == truth]
    return "\n".join([pooled_table(rows), *paper_tables(summarise(rows), truth=truth)])


def pooled_table(scores: Sequence[dict[str, Any]]) -> str:
    """Return means over all scenes, with milliseconds, a row for each method."""
    return markdown(pooled(scores), columns=COLUMNS)


def pooled(
    scores: Iterable[dict[str, Any]],
    *,
    by: tuple[str, ...] = ("truth", "method"),
    columns: Sequence[str] = tuple(COLUMNS),
) -> Summary:
    """Return `summarise` over all scenes."""
    together = (
        row | {"sequence": f"{row['scene']} {row['sequence']}"} for row in scores
    )
    return summarise(together, by=by, columns=columns)


def paper_tables(summary: Summary, *, truth: str, **options: Any) -> list[str]:
    """Return `scenes_table` for the scenes of Table I and for those of Table II.

    Table II holds corridor and hall, which the authors recorded themselves. A table
    without scenes is left out.
    """
    scenes = dict.fromkeys(row["scene"] for row in summary if row["truth"] == truth)
    table_ii = [scene for scene in scenes if scene.lower() in TABLE_II]
    parts = [scene for scene in scenes if scene not in table_ii], table_ii
    return [scenes_table(summary, truth=truth, scenes=s, **options) for s in parts if s]


def csv_table(summary: Summary) -> str:
    """Return the whole summary as CSV: means, intervals and effective frames.

    A line for each truth, scene and method; metres, and F-scores from 0 to 1.
    """
    names = ("truth", "scene", "method", "frames", "empty", "no_truth")
    parts = [*itertools.product(REPEATED, ("mean", "low", "high", "effective"))]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*names, *map(" ".join, parts)])
    for row in summary:
        numbers = [getattr(row[column], part) for column, part in parts]
        cells = ["" if np.isnan(value) else f"{value:.6g}" for value in numbers]
        writer.writerow([*(row[name] for name in names), *cells])
    return text.getvalue()


def write_tables(path: Path | str) -> list[Path]:
    """Write `table.md`, `table.tex` and `table.csv` next to a file of scores.

    They depend on that file alone: times, which never repeat, are left out.
    """
    summary = summarise(read_scores(path))
    truths = dict.fromkeys(row["truth"] for row in summary)

    def of_truths(style: Style) -> list[str]:
        tables = (paper_tables(summary, truth=truth, style=style) for truth in truths)
        return [*itertools.chain.from_iterable(tables)]

    every = markdown(summary, intervals=True)
    note = (
        "Brackets hold 95 % intervals, which allow for correlated frames. Fewer than "
        "four independent frames have none.\n"
    )
    tables = {
        "table.md": "\n".join([*of_truths("markdown"), every, note]),
        "table.tex": "\n".join(of_truths("latex")),
        "table.csv": csv_table(summary),
    }
    folder = Path(path).parent
    for name, text in tables.items():
        write_text(folder / name, text)
    return [folder / name for name in tables]


def seeds_table(runs: Sequence[Path | str]) -> str:
    """Return each method's mean scores over runs, and their deviation from run to run.

    Scores are against the first truth, and scenes are pooled.
    """
    means: dict[str, dict[str, list[float]]] = {}
    for run in runs:
        scores = read_scores(Path(run) / "evaluation" / "frames.jsonl")
        rows: dict[str, list] = {}
        for row in scores:
            if row["truth"] == scores[0]["truth"]:
                rows.setdefault(row["method"], []).append(row)
        for method, found in rows.items():
            seen = [row for row in found if row["truth_points"]]
            for score in IN_SCENES:
                mean = float(np.nanmean([row[score] for row in seen]))
                means.setdefault(method, {}).setdefault(score, []).append(mean)

    def spread(method: str, score: str) -> str:
        text, values = COLUMNS[score].text, means[method][score]
        return f"{text(statistics.mean(values))} ± {text(statistics.stdev(values))}"

    lines = [[m, *(spread(m, score) for score in IN_SCENES), len(runs)] for m in means]
    titles = [COLUMNS[score].title for score in IN_SCENES]
    return markdown_table(["method", *titles, "runs"], lines)


def markdown_table(titles: Sequence[Any], rows: Iterable[Sequence[Any]]) -> str:
    """Return a Markdown table of any cells."""
    head, *body = (
        "| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |"
        for line in (titles, *rows)
    )
    return "\n".join([head, "|---" * len(titles) + "|", *body]) + "\n"


def _latex_table(titles: list[str], rows: list[list[str]], caption: str) -> str:
    head, *body = (" & ".join(line) + r" \\" for line in (titles, *rows))
    return "\n".join(
        [
            r"\begin{table}",
            r"\centering",
            rf"\caption{{{caption}}}",
            rf"\begin{{tabular}}{{l{'c' * (len(titles) - 1)}}}",
            r"\toprule",
            head,
            r"\midrule",
            *body,
            r"\bottomrule",
            r"\end{tabular}",
            r"\end{table}",
            "",
        ]
    )


def _latex(text: str) -> str:
    special = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}"}
    special |= {"^": r"\textasciicircum{}"} | {c: f"\\{c}" for c in "&%$#_{}"}
    return "".join(special.get(character, character) for character in text)


def _cells(
    row: dict[str, Any],
    columns: Collection[str],
    alike: Sequence[dict[str, Any]] = (),
    *,
    style: Style = "markdown",
    intervals: bool = False,
) -> list[str]:
    """Return means as printed; bold where no `alike` row prints a better one."""
    texts = []
    for name in columns:
        estimate, column = row[name], COLUMNS[name]
        if not np.isfinite(estimate.mean):
            texts.append("–")
            continue
        means = [r[name].mean for r in alike if np.isfinite(r[name].mean)]
        text = column.text(estimate.mean)
        best = bool(means) and text == column.text(column.best(means))
        if intervals and np.isfinite(estimate.low):
            low, high = map(column.text, (estimate.low, estimate.high))
            text += f" ({low}{DASH[style]}{high})"
        texts.append(text.join(BOLD[style]) if best else text)
    return texts
