"""Figures of one capture, of range images, and of the confidence of points.

Range images are mirrored, so that left in the picture is left of the radar. Colour is
range in metres; misses are white.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from jradar.files import atomic_path
from jradar.radar import RadarSpec
from jradar.range_image import ImageSpec, project
from jradar.types import PointCloud

STYLES = {  # colour and size of a point
    "LiDAR": ("tab:gray", 1.2),
    "enhanced": ("tab:blue", 1.2),
    "radar": ("tab:red", 2.7),
}
LEGEND_SIZE = 3  # of a marker, beside its size in the picture


def save_figure(figure: Figure, path: Path | str) -> None:
    """Write the figure as PNG."""
    FigureCanvasAgg(figure)
    with atomic_path(path) as scratch:
        figure.savefig(scratch, dpi=110)


def capture_figure(
    power: Float[ArrayLike, "doppler range"],
    radar: RadarSpec,
    cloud: PointCloud,
    image: ImageSpec,
    *,
    dense: PointCloud | None = None,
    lidar: Float[np.ndarray, "point 3"] | None = None,
    title: str = "",
) -> Figure:
    """Draw one capture: range-Doppler map, clouds from above, range image.

    `power` is linear. `dense` is the enhanced cloud. `lidar` holds LiDAR points in the
    radar's frame; only points ahead and within the image's range are drawn.
    """
    figure = Figure(figsize=(13, 5))  # `constrained` layout takes twice as long
    figure.subplots_adjust(left=0.045, right=0.985, bottom=0.26, top=0.86, wspace=0.18)
    spectrum, above, front = figure.subplots(1, 3)
    figure.suptitle(title)
    _draw_spectrum(spectrum, np.asarray(power), radar)
    clouds = {}
    if lidar is not None:
        near = np.linalg.norm(lidar, axis=1) <= image.max_range_m
        clouds["LiDAR"] = lidar[near & (lidar[:, 0] > 0)]
    for name, drawn in (("enhanced", dense), ("radar", cloud)):
        if drawn is not None:
            clouds[name] = np.asarray(drawn.xyz)[np.asarray(drawn.valid)]
    _draw_above(above, clouds)
    picture = _draw_image(front, project(dense or cloud, image), image)
    _add_bar(front, picture, "range (m)")
    shown = "radar" if dense is None else "enhanced"
    front.set_title(f"range image of the {shown} cloud")
    return figure


def samples_figure(columns: dict[str, np.ndarray], image: ImageSpec) -> Figure:
    """Draw range images `[frame, row, column]`, a column for each method."""
    frames = len(next(iter(columns.values())))
    size = 4 * len(columns), 1.5 * frames + 0.4
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(frames, len(columns), squeeze=False)
    for column, (name, images) in enumerate(columns.items()):
        axes[0, column].set_title(name)
        for row in range(frames):
            picture = _draw_image(axes[row, column], images[row], image)
            axes[row, column].set(xticks=[], yticks=[], xlabel="", ylabel="")
            if row == column == 0:
                figure.colorbar(picture, ax=axes, label="range (m)")
    return figure


def reliability_figure(
    diagrams: Mapping[str, tuple[Float[np.ndarray, " bin"], Float[np.ndarray, " bin"]]],
    coverage: Mapping[
        str, tuple[Float[np.ndarray, " part"], Float[np.ndarray, " part"]]
    ],
) -> Figure:
    """Draw the reliability diagram of models, and their precision over coverage.

    `diagrams[model]` holds the mean confidence of each bin and its share of right
    points, NaN where a bin is empty. `coverage[model]` holds the shares of points that
    are kept, and their precision. Everything is from 0 to 1.
    """
    figure = Figure(figsize=(9.4, 4.6), layout="constrained")
    diagram, kept = figure.subplots(1, 2)
    diagram.plot([0, 1], [0, 1], color="0.6", linestyle="--", label="calibrated")
    for axes, lines in ((diagram, diagrams), (kept, coverage)):
        for i, (name, (x, y)) in enumerate(lines.items()):
            known = np.isfinite(x) & np.isfinite(y)
            axes.plot(x[known], y[known], color=f"C{i}", marker="o", label=name)
        axes.set(xlim=(0, 1.02), ylim=(0, 1.02))
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    diagram.set(title="reliability", xlabel="confidence", ylabel="share right")
    kept.set(title="precision", xlabel="share of points kept", ylabel="share right")
    handles, labels = diagram.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    return figure


def _draw_spectrum(axes: Axes, power, radar):
    level = 10 * np.log10(power + power.max() * 1e-12 + 1e-30)
    velocity, distance = radar.max_velocity_mps, radar.max_range_m
    half_bin = radar.velocity_resolution_mps / 2
    picture = axes.imshow(
        level.T,
        origin="lower",
        aspect="auto",
        extent=(-velocity - half_bin, velocity - half_bin, 0, distance),
        vmin=np.percentile(level, 5),
    )
    _add_bar(axes, picture, "power (dB)")
    axes.set(title="range-Doppler map", xlabel="velocity (m/s)", ylabel="range (m)")


def _add_bar(axes: Axes, picture, label: str):
    """Draw the colours of a picture below its axes."""
    place = axes.inset_axes((0, -0.23, 1, 0.04))
    axes.figure.colorbar(picture, cax=place, orientation="horizontal", label=label)


def _draw_above(axes: Axes, clouds):
    """Draw clouds from above: x up, y to the left."""
    for name, xyz in clouds.items():
        colour, size = STYLES[name]
        label = f"{name}: {len(xyz):,}"
        style = {"linestyle": "", "marker": "o", "markeredgewidth": 0}
        axes.plot(
            xyz[:, 1], xyz[:, 0], color=colour, markersize=size, label=label, **style
        )
    axes.plot(0, 0, "k^")
    axes.set(title="from above", xlabel="y, left (m)", ylabel="x, forward (m)")
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_xaxis()
    axes.legend(
        loc="upper center",
        bbox_to_anchor=(0.5, -0.15),
        ncols=len(clouds),
        frameon=False,
        columnspacing=1.2,
        handletextpad=0.1,
        markerscale=LEGEND_SIZE,
    )


def _draw_image(axes: Axes, metres, image: ImageSpec):
    """Draw a range image [row, column] in metres, 0 for a miss; return the picture."""
    metres = np.asarray(metres)
    right, left, low, high = np.degrees([*image.azimuth, *image.elevation])
    picture = axes.imshow(
        np.where(metres > 0, metres, np.nan)[:, ::-1],
        extent=(left, right, low, high),
        aspect="auto",
        vmin=0,
        vmax=image.max_range_m,
        cmap="turbo",
        interpolation="nearest",
    )
    axes.set(xlabel="azimuth (degrees)", ylabel="elevation (degrees)")
    return picture
