"""Tables from scores: every mean with its interval, and the paper's Tables I and II.

Distances are means over the frames in which the method found points. A frame without
points has the F-score 0. The number of such frames is printed beside the means.
"""

import csv
import io
import itertools
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from jradar.evaluation.scores import DISTANCES, F_SCORES, read_scores
from jradar.evaluation.statistics import Estimate, mean_interval
from jradar.files import write_text

Style = Literal["markdown", "latex"]
Summary = list[dict[str, Any]]

COLUMNS = {
    "chamfer": "CD (m)",
    "modified_hausdorff": "MHD (m)",
    "f_score_0.1": "F 0.1 m (%)",
    "f_score_0.2": "F 0.2 m (%)",
    "f_score_0.5": "F 0.5 m (%)",
    "points": "points",
}
TABLE_II = ("corridor", "hall")
TIME = {"milliseconds": "ms"}
BOLD = {"markdown": ("**", "**"), "latex": (r"\textbf{", "}")}
PLUS_MINUS = {"markdown": "±", "latex": r"$\pm$"}
MARK = {"markdown": " †", "latex": r"\textsuperscript{\dag}"}


def summarise(scores: Iterable[dict[str, Any]]) -> Summary:
    """Return an `Estimate` of every score, a row for each truth, scene and method.

    Rows are in order of appearance. `empty` counts frames in which the method found
    nothing; `no_truth` counts frames with an empty truth, which are left out.
    """
    groups: dict[tuple, dict[str, list]] = {}
    for row in scores:
        group = (row["truth"], row["scene"], row["method"])
        groups.setdefault(group, {}).setdefault(row["sequence"], []).append(row)
    summary = []
    for (truth, scene, method), sequences in groups.items():
        ordered = [
            [r for r in sorted(rows, key=lambda r: r["frame"]) if r["truth_points"]]
            for rows in sequences.values()
        ]
        rows = [row for sequence in ordered for row in sequence]
        estimates = {
            column: mean_interval([[r[column] for r in s] for s in ordered])
            for column in (*COLUMNS, *TIME)
        }
        counts = {
            "frames": len(rows),
            "empty": sum(not row["points"] for row in rows),
            "no_truth": sum(map(len, sequences.values())) - len(rows),
        }
        names = {"truth": truth, "scene": scene, "method": method}
        summary.append({**names, **estimates, **counts})
    return summary


def markdown(
    summary: Summary, *, intervals: bool = False, milliseconds: bool = False
) -> str:
    """Return a summary as a Markdown table, F-scores in percent.

    Truth and scene are columns if they vary. `intervals` adds half the width of the
    95 % interval to each mean.
    """
    columns = COLUMNS | (TIME if milliseconds else {})
    names = [
        name
        for name in ("truth", "scene", "method")
        if name == "method" or len({row[name] for row in summary}) > 1
    ]
    titles, lines = [*names, *columns.values(), "frames", "empty"], []
    for row in summary:
        cells = [_number(row[c], c, intervals, "markdown") for c in columns]
        lines.append([row[n] for n in names] + cells + [row["frames"], row["empty"]])
    return markdown_table(titles, lines)


def scenes_table(
    summary: Summary,
    *,
    truth: str | None = None,
    scenes: Sequence[str] | None = None,
    style: Style = "markdown",
    threshold_m: float = 0.2,
    intervals: bool = False,
) -> str:
    """Return the paper's table: a row for each method, a column for each scene.

    A cell holds CD (m) / MHD (m) / F-score (%), the best of each scene in bold. `truth`
    is by default the first one; `intervals` adds half the width of the 95 % interval.
    A caption counts the frames in which a method found nothing. LaTeX needs booktabs.
    Raises ValueError for an unknown scene or a threshold that was not scored.
    """
    truth = truth or summary[0]["truth"]
    rows = {(r["method"], r["scene"]): r for r in summary if r["truth"] == truth}
    known = [*dict.fromkeys(scene for _, scene in rows)]
    scenes = known if scenes is None else [*scenes]
    if not scenes or not set(scenes) <= set(known):
        raise ValueError(f"{scenes=} against {truth!r}, expected some of {known}")
    scores = (*DISTANCES, f"f_score_{threshold_m}")
    if scores[-1] not in F_SCORES:
        raise ValueError(f"{threshold_m=} was not scored, expected one of {F_SCORES}")
    methods = [*dict.fromkeys(method for method, scene in rows if scene in scenes)]
    best = {
        scene: [_best([r for (_, s), r in rows.items() if s == scene], score)
                for score in scores]
        for scene in scenes
    }  # fmt: skip

    def cell(method, scene):
        if (row := rows.get((method, scene))) is None:
            return "–"
        texts = [_number(row[score], score, intervals, style) for score in scores]
        for i, score in enumerate(scores):
            if _number(row[score], score) == best[scene][i]:
                texts[i] = texts[i].join(BOLD[style])
        return " / ".join(texts) + (MARK[style] if row["empty"] else "")

    escape = _latex if style == "latex" else str
    titles = ["method", *map(escape, scenes)]
    lines = [[escape(m), *(cell(m, scene) for scene in scenes)] for m in methods]
    notes = [
        f"{method} found nothing in {row['empty']} of {row['frames']} frames of {scene}"
        for (method, scene), row in rows.items()
        if row["empty"] and scene in scenes
    ]
    caption = escape(f"{' / '.join(COLUMNS[s] for s in scores)} against {truth}.")
    if notes:
        notes = escape(f"{'; '.join(notes)}: no distance, F-score 0.")
        caption += f"{MARK[style]} {notes}"
    if style == "latex":
        return _latex_lines([titles, *lines], caption)
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
    together = [
        row | {"scene": "all", "sequence": f"{row['scene']} {row['sequence']}"}
        for row in scores
    ]
    return markdown(summarise(together), milliseconds=True)


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
    parts = ("mean", "low", "high", "effective")
    text = io.StringIO()
    write = csv.writer(text, lineterminator="\n").writerow
    write([*names, *(f"{column} {part}" for column in COLUMNS for part in parts)])
    for row in summary:
        numbers = [getattr(row[column], part) for column in COLUMNS for part in parts]
        write([row[n] for n in names] + [f"{x:.6g}" if x == x else "" for x in numbers])
    return text.getvalue()


def markdown_table(titles: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Return rows of texts or numbers as a Markdown table."""
    lines = [
        "| " + " | ".join(str(cell).replace("|", "\\|") for cell in row) + " |"
        for row in (titles, *rows)
    ]
    return "\n".join([lines[0], "|---" * len(titles) + "|", *lines[1:]]) + "\n"


def write_tables(path: Path | str) -> list[Path]:
    """Write `table.md`, `table.tex` and `table.csv` beside a file of scores.

    They depend on that file alone: times, which never repeat, are left out.
    """
    summary = summarise(read_scores(path))
    truths = dict.fromkeys(row["truth"] for row in summary)

    def of_truths(style: Style) -> list[str]:
        tables = (paper_tables(summary, truth=truth, style=style) for truth in truths)
        return [*itertools.chain.from_iterable(tables)]

    every = markdown(summary, intervals=True)
    note = "± is half of a 95 % interval that allows for correlated frames.\n"
    tables = {
        "table.md": "\n".join([*of_truths("markdown"), every, note]),
        "table.tex": "\n".join(of_truths("latex")),
        "table.csv": csv_table(summary),
    }
    folder = Path(path).parent
    for name, text in tables.items():
        write_text(folder / name, text)
    return [folder / name for name in tables]


def format_score(value: float, column: str, *, sign: str = "") -> str:
    """Return a score as printed: metres, or F-scores in percent."""
    if column in F_SCORES:
        return f"{100 * value:{sign}.1f}"
    digits = 3 if column in DISTANCES else 0 if column == "points" else 1
    return f"{value:{sign}.{digits}f}"


def _number(
    estimate: Estimate, column: str, intervals: bool = False, style: Style = "markdown"
) -> str:
    """Return a mean as printed, optionally with half of its interval's width."""
    if not np.isfinite(estimate.mean):
        return "–"
    text = format_score(estimate.mean, column)
    if intervals and np.isfinite(estimate.half_width):
        text += f" {PLUS_MINUS[style]} {format_score(estimate.half_width, column)}"
    return text


def _best(rows, score):
    """Return the best mean of a score as printed: all methods that print it tie."""
    known = [row[score] for row in rows if np.isfinite(row[score].mean)]
    pick = max if score in F_SCORES else min
    return _number(pick(known, key=lambda e: e.mean), score) if known else None


def _latex_lines(lines: list[list[str]], caption: str) -> str:
    head, *body = (" & ".join(line) + r" \\" for line in lines)
    return "\n".join(
        [
            r"\begin{table}",
            r"\centering",
            rf"\caption{{{caption}}}",
            rf"\begin{{tabular}}{{l{'c' * (len(lines[0]) - 1)}}}",
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
