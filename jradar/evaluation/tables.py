"""Tables of mean scores."""

from collections.abc import Iterable
from typing import Any

import numpy as np

COLUMNS = {
    "chamfer": "CD (m)",
    "modified_hausdorff": "MHD (m)",
    "f_score_0.1": "F 0.1 m (%)",
    "f_score_0.2": "F 0.2 m (%)",
    "f_score_0.5": "F 0.5 m (%)",
    "points": "points",
}


def summarise(scores: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Mean of every score over frames, a row for each method in order of appearance.

    Frames whose scores are NaN, since a cloud was empty, are left out and counted.
    """
    by_method: dict[str, list[dict[str, Any]]] = {}
    for row in scores:
        by_method.setdefault(row["method"], []).append(row)
    table = []
    for method, rows in by_method.items():
        scored = [row for row in rows if np.isfinite(row["chamfer"])]
        means = {
            column: float(np.mean([row[column] for row in scored]))
            if scored
            else np.nan
            for column in COLUMNS
        }
        counts = {"frames": len(rows), "empty": len(rows) - len(scored)}
        table.append({"method": method, **means, **counts})
    return table


def markdown(table: list[dict[str, Any]]) -> str:
    """The table in Markdown, F-scores in percent."""
    lines = [
        "| method | " + " | ".join(COLUMNS.values()) + " | frames | empty |",
        "|---" * (len(COLUMNS) + 3) + "|",
    ]
    for row in table:
        cells = [
            f"{100 * row[c]:.1f}" if c.startswith("f_") else f"{row[c]:.3f}"
            for c in list(COLUMNS)[:-1]
        ]
        cells += [f"{row['points']:.0f}", str(row["frames"]), str(row["empty"])]
        lines.append(f"| {row['method']} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"
