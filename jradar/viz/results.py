"""Figures of results: error curves, clouds side by side, learning curves.

Clouds are drawn from behind and above the sensor. Colour is height, red is high.
"""

import json
import math
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, ScalarFormatter

MAX_CURVE_POINTS = 2000
AVERAGED = 100  # steps of the strong learning curve, at most
MAX_DOTS = 30  # values up to which a curve has markers
CAMERA_DEG = (28.0, -155.0)  # elevation, azimuth

# The fourth column is confidence, 0 to 1.
Points = Float[np.ndarray, "_ 3"] | Float[np.ndarray, "_ 4"]


def error_curves_figure(
    errors: Mapping[str, Mapping[str, Sequence[float | int] | np.ndarray]],
) -> Figure:
    """Draw the cumulative distribution of the Chamfer distance per scene (Fig. 6).

    `errors[scene][method]` holds a number per frame. NaN means that the method found
    nothing, which is worse than any error, so the curve ends below 1. The axis ends
    where every method has at least 98 % of its errors. Raises ValueError without
    scenes.
    """
    if not errors:
        raise ValueError("no scenes to draw, expected at least one")
    columns = min(len(errors), 4)
    rows = math.ceil(len(errors) / columns)
    size = max(3.4 * columns, 5), 3 * rows + 0.6
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
    names = [*dict.fromkeys(name for methods in errors.values() for name in methods)]
    for axes, (scene, methods) in zip(grid.flat, errors.items(), strict=False):
        limits = []
        for name, values in methods.items():
            values = np.asarray(values, np.float64)
            known = np.sort(values[np.isfinite(values)])
            if len(known):
                limits.append(np.percentile(known, 98))
            share = np.arange(1, len(known) + 1) / max(len(values), 1)
            index = names.index(name)
            axes.step(
                [0.0, *known, *(1e6 for _ in known[-1:])],  # to the picture's edge
                [0.0, *share, *share[-1:]],
                where="post",
                color=f"C{index}",
                linestyle=("-", "--", "-.", ":")[index // 10 % 4],
                linewidth=2.4 if index == len(names) - 1 else 1.5,
                label=name,
            )
        axes.set(title=scene, xlabel="Chamfer distance (m)", ylim=(0, 1.02))
        axes.set_xlim(0, 1.05 * max(limits, default=1.0) or 1.0)
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    for axes in grid.flat[len(errors) :]:
        axes.remove()
    for axes in grid[:, 0]:
        axes.set_ylabel("share of frames")
    handles = {
        text: handle
        for axes in figure.axes
        for handle, text in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(
        [handles[name] for name in names], names, loc="outside lower center",
        ncols=min(len(names), 6), frameon=False,
    )  # fmt: skip
    return figure


def bars_figure(
    values: Mapping[str, Mapping[str, float]], *, ylabel: str = ""
) -> Figure:
    """Draw `values[method][group]` as bars, side by side in each group."""
    groups = [*dict.fromkeys(name for named in values.values() for name in named)]
    figure = Figure(figsize=(1.6 * len(groups) + 2, 4), layout="constrained")
    axes = figure.add_subplot()
    width = 0.8 / max(len(values), 1)
    for i, (name, named) in enumerate(values.items()):
        heights = [named.get(group, math.nan) for group in groups]
        places = np.arange(len(groups)) + (i - (len(values) - 1) / 2) * width
        axes.bar(places, heights, width, label=name)
    axes.set_xticks(range(len(groups)), groups)
    axes.set_ylabel(ylabel)
    axes.grid(alpha=0.3, axis="y")
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside lower center", ncols=4, frameon=False)
    return figure


def clouds_figure(
    scenes: Mapping[str, Mapping[str, Points]], *, enlarged: Collection[str] = ()
) -> Figure:
    """Draw clouds, a row per scene and a column per method (Fig. 5).

    The panels of a row share view, limits and colours. The limits leave out the
    outermost 1 % of the points. Methods in `enlarged` have points of twice the size.
    Confidence, the fourth column of some clouds, is not drawn. Raises ValueError
    without clouds.
    """
    names = [*dict.fromkeys(name for row in scenes.values() for name in row)]
    if not names:
        raise ValueError("no clouds to draw, expected at least one")
    size = 3.1 * len(names) + 0.8, 2.6 * len(scenes) + 0.3
    figure = Figure(figsize=size, layout="constrained")
    shape = {"squeeze": False, "subplot_kw": {"projection": "3d"}}
    grid: Any = figure.subplots(len(scenes), len(names), **shape)
    for row, (scene, clouds) in enumerate(scenes.items()):
        every = [points[:, :3] for points in clouds.values()]
        together = np.concatenate([*every, np.zeros((1, 3))])
        low, high = np.percentile(together, (0.5, 99.5), axis=0)
        low, high = np.minimum(low, 0), np.maximum(high, low + 1)  # with the sensor
        norm = Normalize(low[2], high[2])
        panels = grid[row]
        for column, (axes, name) in enumerate(zip(panels, names, strict=True)):
            xyz = clouds.get(name, np.zeros((0, 3)))[:, :3]
            xyz = xyz[((xyz >= low - 0.5) & (xyz <= high + 0.5)).all(1)]
            area = (1.2 if len(xyz) > 3000 else 3.0) * (4 if name in enlarged else 1)
            look: dict[str, Any] = {"s": area, "cmap": "turbo", "norm": norm}
            axes.scatter(*xyz.T, c=xyz[:, 2], linewidths=0, depthshade=False, **look)
            _set_view(axes, low, high)
            if row == 0:
                axes.set_title(name, y=1.0)
            if column == 0:
                style = {"transform": axes.transAxes, "va": "top", "weight": "bold"}
                axes.text2D(-0.05, 0.86, scene, **style)
        heights = ScalarMappable(norm, "turbo")
        figure.colorbar(heights, ax=panels, label="height (m)", shrink=0.75, pad=0.01)
    return figure


def velocities_figure(
    stamps: Float[np.ndarray, " frame"],
    measured: Float[np.ndarray, "frame 3"],
    expected: Float[np.ndarray, "frame 3"],
) -> Figure:
    """Draw a radar's velocities (m/s) by Doppler and by poses, and their difference."""
    figure = Figure(figsize=(9, 6), layout="constrained")
    rows: Any = figure.subplots(3, sharex=True)
    time, names = stamps - stamps[0], ("ahead", "to the left", "up")
    for axis, (axes, name) in enumerate(zip(rows, names, strict=True)):
        off = measured[:, axis] - expected[:, axis]
        axes.plot(time, measured[:, axis], ".", color="tab:red", label="by Doppler")
        axes.plot(time, expected[:, axis], color="tab:blue", label="by poses and mount")
        axes.plot(time, off, color="0.6", lw=0.8, label="difference")
        axes.set_ylabel(f"{name} (m/s)")
        axes.set_title(f"rms difference {np.sqrt(np.mean(off**2)):.3f} m/s", size=9)
    rows[0].legend(loc="upper right", ncols=3, fontsize=8)
    rows[2].set_xlabel("time (s)")
    return figure


def learning_curve_figure(path: Path | str) -> Figure:
    """Draw every number of a `metrics.jsonl` over the steps, an axis each.

    The faint line shows every step. The strong line is the mean of the last 100 steps,
    or of a tenth of all steps if that is fewer. Short curves have markers. A last line
    that is still being written is left out, and so are numbers that are null. Raises
    ValueError, naming the line, for a damaged file.
    """
    records = _read_metrics(Path(path))
    names = {name for record in records for name in record} - {"step"}
    names = sorted(names, key=lambda name: (name != "loss", "/" not in name, name))
    rows, columns = math.ceil(len(names) / 2), min(len(names), 2)
    figure = Figure(figsize=(6.4 * columns, 3.4 * rows), layout="constrained")
    for i, name in enumerate(names):
        axes = figure.add_subplot(rows, columns, i + 1)
        pairs = [(r["step"], r[name]) for r in records if name in r]
        steps, values = np.array(pairs, np.float64).T
        span = max(min(AVERAGED, len(values) // 10), 1)
        sums = np.cumsum(np.insert(values, 0, 0.0))
        smooth = (sums[span:] - sums[:-span]) / span
        thin = max(len(steps) // MAX_CURVE_POINTS, 1)
        axes.plot(steps[::thin], values[::thin], color="C0", alpha=0.25, linewidth=0.8)
        dots = "o" if len(values) <= MAX_DOTS else None
        style = {"color": "C0", "linewidth": 1.8, "marker": dots}
        axes.plot(steps[span - 1 :][::thin], smooth[::thin], **style)
        if values.min() > 0 and values.max() > 3 * values.min():
            axes.set_yscale("log")
            axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axes.yaxis.set_major_formatter(ScalarFormatter())
            axes.yaxis.set_minor_formatter(NullFormatter())
        axes.set(xlabel="step", title=name.replace("_", " "))
        axes.grid(alpha=0.3, which="both")
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def _set_view(axes, low, high):
    """Set equal scales, the camera and faint axes."""
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low, zoom=1.35)
    axes.set_proj_type("persp", focal_length=0.6)
    axes.view_init(*CAMERA_DEG)
    axes.tick_params(labelsize=6, pad=-3, length=0)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.pane.fill = False
        axis.pane.set_edgecolor("0.8")
        axis._axinfo["grid"].update(color="0.9", linewidth=0.5)
        axis.set_major_locator(MaxNLocator(4, integer=True))


def _read_metrics(path):
    records = []
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    for number, line in enumerate(lines, 1):
        try:
            record = json.loads(line)
            if not isinstance(record["step"], int):
                raise ValueError(f"step is {record['step']!r}")
            numbers = {k: float(v) for k, v in record.items() if v is not None}
        except (
            ArithmeticError,
            LookupError,
            RecursionError,
            TypeError,
            ValueError,
        ) as e:
            if number == len(lines):
                break
            raise ValueError(f"{path}, line {number}: {e!r}") from e
        records.append(numbers)
    if not records:
        raise ValueError(f"{path} holds no steps: train first")
    return records
