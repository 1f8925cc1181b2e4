"""What an evaluation on RadarHD's pairs writes: scores, tables, pictures.

There is a table for each protocol: over all frames, by building, by trajectory. The
folder's test trajectories are from three buildings; those up to 140 are from the
building of the training trajectories.
"""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from ml_collections import ConfigDict

from experiments.radarhd.confidence import confidence_table
from experiments.radarhd.pairs import RadarHD
from experiments.radarhd.pictures import picture, worst_picture
from experiments.radarhd.scores import (
    CHOSEN_BY,
    PROTOCOLS,
    Draw,
    Limits,
    Rows,
    score_pairs,
)
from experiments.tables import markdown_table
from jradar import evaluation, viz
from jradar.files import write_text
from jradar.metrics import THRESHOLDS_M
from jradar.range_image import ConfidenceTable

COLUMNS = {  # of the tables: score, title, scale, digits
    "chamfer": ("Chamfer (m)", 1, 3),
    "modified_hausdorff": ("MHD (m)", 1, 3),
    **{f"f_score_{limit}": (f"F {limit} m (%)", 100, 1) for limit in THRESHOLDS_M},
}
BUILDINGS = {  # trajectories, both ends included
    (112, 140): "112 to 140, building of the training trajectories",
    (227, 246): "227 to 246, another building",
    (247, 250): "247 to 250, another building",
}
TITLES = {
    "polar": "Polar pixels (`polar`)",
    "cartesian": "RadarHD's Cartesian grid (`cartesian`)",
}
NOTES = {
    "polar": "Distances are means over the frames in which the method found points; "
    "the `empty` ones count as 0 in the F-scores.",
    "cartesian": "Empty predictions and truths count as the one point (0, 0, 0).",
}
CONFIDENCE_NOTE = (
    "A cell is right if the LiDAR has one within 0.2 m. The confidence of a value is "
    "its frequency on the trajectories that the limits are chosen on; the error is the "
    "mean distance of confidence and frequency, by cells."
)


def building(trajectory: int) -> str:
    """Return the building of a trajectory of the public folder."""
    for (first, last), name in BUILDINGS.items():
        if first <= trajectory <= last:
            return name
    return "unknown building"


def write_results(
    config: ConfigDict,
    workdir: Path,
    title: str,
    pairs: RadarHD,
    draws: dict[str, Draw],
    limits: Limits,
    confidence: dict[str, ConfidenceTable],
) -> None:
    """Score methods at their limits; write scores, confidence, tables and pictures."""
    every = config.data.every
    started = time.perf_counter()
    rows = [
        *score_pairs(
            config, pairs, draws, every=every, limits=limits, protocols=PROTOCOLS
        )
    ]
    seconds = time.perf_counter() - started
    out = workdir / "evaluation"
    write_text(out / "frames.jsonl", "".join(json.dumps(row) + "\n" for row in rows))
    frames = len({(row["trajectory"], row["frame"]) for row in rows})
    which = "every frame" if every == 1 else f"one frame in {every}"
    tables = [f"# {title}\n\n{frames} frames: {which}.\n"]
    tables += [
        f"## {TITLES[protocol]}\n\n{tables_of(rows, protocol, limits[protocol])}"
        for protocol in PROTOCOLS
    ]
    frequencies = {name: spec.frequencies for name, spec in confidence.items()}
    write_text(out / "confidence.json", json.dumps(frequencies, indent=2) + "\n")
    table = confidence_table(rows, confidence, lambda row: building(row["trajectory"]))
    tables += [f"## Confidence of Cartesian cells\n\n{table}\n{CONFIDENCE_NOTE}\n"]
    write_text(out / "table.md", text := "\n".join(tables))
    viz.save_figure(picture(config, pairs, draws, limits), out / "samples.png")
    worst = worst_picture(config, pairs, draws, limits, rows)
    viz.save_figure(worst, out / "worst.png")
    print(f"{text}\nwritten to {out}; drawn and scored in {seconds:.0f} s")


def tables_of(rows: Rows, protocol: str, limits: Any) -> str:
    """Return the tables of a protocol: all frames, by building, by trajectory."""
    rows = [row for row in rows if row["protocol"] == protocol]
    tables = markdown(rows, limits, note=NOTES[protocol])
    for name, group in (
        ("building", lambda row: building(row["trajectory"])),
        ("trajectory", lambda row: str(row["trajectory"])),
    ):
        tables += "\n" + grouped_markdown(rows, limits, name, group)
    return tables


def markdown(rows: Rows, limits: Any, *, note: str = NOTES["polar"]) -> str:
    """Return a table of means with 95 % intervals that allow for correlated frames."""
    titles = ["method", "limit", *score_titles(), "frames", "empty"]
    lines, left_out = [], 0
    for method, limit in limits.items():
        cells, frames, empty, left_out = summary(
            [row for row in rows if row["method"] == method]
        )
        lines.append([method, f"{limit:.2f}", *cells, str(frames), str(empty)])
    if left_out:
        note += f" {left_out} frames with an empty truth are left out."
    return f"{markdown_table(titles, lines)}\n{note}\n"


def grouped_markdown(
    rows: Rows, limits: Any, name: str, group: Callable[[dict], str]
) -> str:
    """Return a table with a line for each group of frames and each method."""
    lines = []
    for label in dict.fromkeys(map(group, rows)):
        for method in limits:
            mine = [r for r in rows if r["method"] == method and group(r) == label]
            cells, frames, empty, _ = summary(mine)
            lines.append([label, method, *cells, str(frames), str(empty)])
    titles = [name, "method", *score_titles(), "frames", "empty"]
    return markdown_table(titles, lines)


def score_titles() -> list[str]:
    """Return the titles of the scores' columns."""
    return [title for title, _, _ in COLUMNS.values()]


def summary(rows: Rows) -> tuple[list[str], int, int, int]:
    """Return cells of means with intervals, and the frames scored, empty, left out."""
    mine = [row for row in rows if not np.isnan(row[CHOSEN_BY])]
    trajectories = sorted({row["trajectory"] for row in mine})
    cells = []
    for name, (_, scale, digits) in COLUMNS.items():
        estimate = evaluation.mean_interval(
            [
                [row[name] for row in mine if row["trajectory"] == trajectory]
                for trajectory in trajectories
            ]
        )
        mean, low, high = (
            f"{scale * value:.{digits}f}"
            for value in (estimate.mean, estimate.low, estimate.high)
        )
        cells.append(f"{mean} ({low} to {high})")
    empty = sum(not row["points"] for row in mine)
    return cells, len(mine), empty, len(rows) - len(mine)
