"""The preparation of one LiDAR scan, step by step, as a figure.

Each step has a column: the scan from above (x up, y to the left), and below it from
the side (x to the right, z up). Colour is height, removed points are grey, radar points
are rings.
"""

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jradar.lidar import LidarSpec, returns
from jradar.lidar.preprocess import LidarSteps

COLOURS, REMOVED, RADAR = "viridis", "0.82", "crimson"
WIDTH = 3.6  # inches of a column
BEHIND, MARGIN = 0.3, 1.04  # drawn behind and ahead, in maximum ranges


def preparation_figure(
    steps: LidarSteps,
    radar_xyz: Float[np.ndarray, "echo 3"],
    spec: LidarSpec,
    *,
    title: str = "",
) -> Figure:
    """Draw the points that each step of a LiDAR scan's preparation keeps.

    `radar_xyz` are the radar points with which clusters were compared.
    """
    stages = _stages(steps)
    behind, ahead = -BEHIND * spec.max_range_m, MARGIN * spec.max_range_m
    bottom, top = _height_limits(steps)
    depth = ahead - behind
    inches = WIDTH * depth / (2 * ahead), WIDTH * (top - bottom) / depth
    size = WIDTH * len(stages) + 1.2, sum(inches) + 2.4
    figure = Figure(size, layout="constrained")
    figure.suptitle(title, fontsize=14)
    shape: Any = {"sharex": "row", "sharey": "row", "height_ratios": inches}
    axes = figure.subplots(2, len(stages), **shape)
    heights = steps.xyz[steps.in_view, 2]
    low, high = np.percentile(heights, [1, 99]) if len(heights) else (-1.0, 1.0)
    colours = ScalarMappable(Normalize(float(low), float(high)), COLOURS)
    echoes = radar_xyz[returns(radar_xyz)]
    for column, (name, kept, removed) in enumerate(stages):
        clouds = steps.xyz[removed], steps.xyz[kept], echoes
        above, side = axes[:, column]
        _draw_clouds(above, clouds, colours, right=1, up=0)
        _draw_clouds(side, clouds, colours, right=0, up=2)
        _draw_wedge(above, spec.azimuth, spec.max_range_m, turned=True)
        _draw_wedge(side, spec.elevation, spec.max_range_m, turned=False)
        above.set_title(f"{name}\n{kept.sum():,} points", fontsize=11)
        above.set_xlabel("y, left (m)")
        side.set_xlabel("x, forward (m)")
    axes[0, 0].set(xlim=(ahead, -ahead), ylim=(behind, ahead), ylabel="x, forward (m)")
    axes[1, 0].set(xlim=(behind, ahead), ylim=(bottom, top), ylabel="z, up (m)")
    label = "height above the radar (m)"
    figure.colorbar(colours, ax=axes, label=label, aspect=40, pad=0.01)
    _draw_legend(figure)
    return figure


def _stages(steps):
    real = returns(steps.xyz)
    above = steps.in_view & ~steps.ground
    upright = above & ~steps.ceiling
    return [
        ("radar's frame", real, np.zeros_like(real)),
        ("shared field of view", steps.in_view, real & ~steps.in_view),
        ("without floor", above, steps.ground),
        ("without ceiling", upright, steps.ceiling),
        ("seen by the radar", steps.visible, upright & ~steps.visible),
    ]


def _height_limits(steps):
    heights = steps.xyz[steps.in_view, 2]
    low, high = (heights.min(), heights.max()) if len(heights) else (0.0, 0.0)
    return float(min(low - 0.6, -2)), float(max(high + 0.6, 2))


def _draw_clouds(axes: Axes, clouds, colours, *, right, up):
    """Draw removed points, kept points and radar points by two coordinates."""
    removed, kept, echoes = clouds
    points = {"s": 1.5, "linewidths": 0}
    axes.scatter(removed[:, right], removed[:, up], c=REMOVED, **points)
    shades = colours.to_rgba(kept[:, 2])
    axes.scatter(kept[:, right], kept[:, up], c=shades, **points)
    rings = {"facecolors": "none", "edgecolors": RADAR, "linewidths": 0.8}
    axes.scatter(echoes[:, right], echoes[:, up], s=16, **rings)
    axes.plot(0, 0, "k^", markersize=6, zorder=5)
    axes.set_aspect("equal")
    axes.grid(color="0.93", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def _draw_wedge(axes: Axes, angles, reach, *, turned):
    """Draw the edge of the field of view; x points up if `turned`."""
    arc = np.linspace(angles[0], angles[1], 61)
    forward = np.r_[0, reach * np.cos(arc), 0]
    across = np.r_[0, reach * np.sin(arc), 0]
    line = (across, forward) if turned else (forward, across)
    axes.plot(*line, color="0.45", linewidth=0.8, linestyle=(0, (4, 3)))


def _draw_legend(figure: Figure):
    ring: Any = {"marker": "o", "markerfacecolor": "none", "color": RADAR}
    marks = [
        Line2D([], [], linestyle="", label="radar points", **ring),
        Line2D(
            [],
            [],
            linestyle="",
            label="removed by this step",
            marker="o",
            color=REMOVED,
        ),
        Line2D([], [], label="field of view", color="0.45", linestyle=(0, (4, 3))),
        Line2D([], [], linestyle="", label="radar", marker="^", color="k"),
    ]
    figure.legend(handles=marks, loc="outside lower center", ncols=4, frameon=False)
