"""Means and curves that tasks and studies write; tables are those of `evaluation`."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator

from jradar.evaluation import csv_text as csv_text, markdown_table as markdown_table

Rows = list[dict[str, Any]]


def mean_rows(rows: Rows, keys: tuple[str, ...]) -> Rows:
    """Return the means of all numbers over rows with the same `keys`, in order.

    The column `frames` counts the rows of each mean.
    """
    groups: dict[tuple, list] = {}
    for row in rows:
        groups.setdefault(tuple(row[key] for key in keys), []).append(row)
    return [
        dict(zip(keys, group, strict=True))
        | {"frames": len(members)}
        | {
            name: float(np.nanmean([member[name] for member in members]))
            for name in members[0]
            if name not in keys
        }
        for group, members in groups.items()
    ]


def known_mean(values: Iterable[float]) -> float:
    """Return the mean of the values that are not NaN, or NaN if there is none."""
    known = [value for value in values if not np.isnan(value)]
    return float(np.mean(known)) if known else np.nan


def curves_figure(
    panels: dict[str, dict[str, list[tuple[float, float]]]],
    *,
    xlabel: str,
    ylabels: list[str],
) -> Figure:
    """Return a figure with named lines of (x, y) in each panel; x is logarithmic."""
    figure = Figure(figsize=(4.6 * len(panels), 3.8), layout="constrained")
    axes_row = figure.subplots(1, len(panels), squeeze=False)[0]
    for axes, (title, lines), label in zip(
        axes_row, panels.items(), ylabels, strict=True
    ):
        for name, points in lines.items():
            axes.plot(*zip(*points, strict=True), marker="o", label=name)
        ticks = sorted({x for points in lines.values() for x, _ in points})
        axes.set(title=title, xlabel=xlabel, ylabel=label, xscale="log")
        axes.set_ylim(bottom=0)
        axes.xaxis.set_major_locator(FixedLocator(ticks))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set_xticklabels([f"{x:g}" for x in ticks])
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    handles, labels = axes_row[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=6, frameon=False)
    return figure
