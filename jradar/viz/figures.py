"""Figures of one capture, of range images, and of the confidence of points.

Range images are mirrored, so that left in the picture is left of the radar. Colour is
range in metres; misses are white.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float, Inexact
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from jradar.files import atomic_path
from jradar.radar import PointSpec, Radar, RadarSpec, azimuth_map
from jradar.radar.angle.spectrum import direction_sines
from jradar.radar.echoes import MIN_RANGE_M
from jradar.radar.points import frame_spectra
from jradar.range_image import ImageSpec, project
from jradar.types import PointCloud

STYLES = {  # colour and size of a point
    "LiDAR": ("tab:gray", 1.2),
    "detections": ("tab:red", 2.7),
    "radar points": ("tab:red", 2.7),
    "radar points above the noise": ("tab:red", 2.7),
    "jradar": ("tab:blue", 1.2),
}
LEGEND_SIZE = 3  # of a marker, relative to its size in the picture


def save_figure(figure: Figure, path: Path | str) -> None:
    """Write the figure as PNG."""
    FigureCanvasAgg(figure)
    with atomic_path(path) as scratch:
        figure.savefig(scratch, dpi=110)


def range_doppler(
    cube: Inexact[ArrayLike, "tx rx chirp sample"], radar: Radar
) -> Figure:
    """Draw the power of one frame over velocity and range, without its leakage."""
    _, power = frame_spectra(jnp.asarray(cube), radar, PointSpec())
    figure, axes = _single()
    _draw_spectrum(axes, np.asarray(power), radar.spec)
    return figure


def range_azimuth(
    cube: Inexact[ArrayLike, "tx rx chirp sample"], radar: Radar
) -> Figure:
    """Draw the power of one frame over azimuth and range, as `azimuth_map` has it."""
    spectra = frame_spectra(jnp.asarray(cube), radar, PointSpec())
    figure, axes = _single()
    _draw_azimuths(axes, np.asarray(azimuth_map(*spectra, radar.spec)), radar.spec)
    return figure


def _single() -> tuple[Figure, Axes]:
    """Return a figure of one panel with room for a bar below."""
    figure = Figure(figsize=(5, 5))
    figure.subplots_adjust(left=0.13, right=0.96, bottom=0.26, top=0.9)
    return figure, figure.subplots()


class CaptureMaps(NamedTuple):
    """The maps of a frame of samples, in linear power."""

    power: Float[ArrayLike, "doppler range"]
    azimuths: Float[ArrayLike, "range azimuth"]  # the `azimuth_map`
    radar: RadarSpec


def capture_figure(
    cloud: PointCloud,
    image: ImageSpec,
    *,
    maps: CaptureMaps | None = None,
    dense: PointCloud | None = None,
    metres: Float[np.ndarray, "row column"] | None = None,
    polar: Float[np.ndarray, "polar_range polar_azimuth"] | None = None,
    lidar: Float[np.ndarray, "point 3"] | None = None,
    title: str = "",
    verdict: str = "",
) -> Figure:
    """Draw one capture: maps of power, clouds from above, range image.

    `cloud` holds the detections, or without `maps` the points that the radar sent;
    `dense` is the enhanced cloud, drawn above them, and `metres` its range image; if
    None, it is projected. A `polar` image, from -90 to 90 degrees and to the range of
    `image`, is drawn in its place. `lidar` holds LiDAR points in the radar's frame, of
    which those ahead are drawn. Points beyond the image's range are not drawn. Colours
    of `dense` are its confidence, if it has any, and the `verdict` stands below the
    title.
    """
    parts = 2 if maps is None else 4
    # The `constrained` layout takes twice as long.
    figure = Figure(figsize=(4.25 * parts, 5.6))
    edges = {"left": 0.17 / parts, "right": 1 - 0.04 / parts, "wspace": 0.22}
    figure.subplots_adjust(**edges, bottom=0.23, top=0.77)
    *before, above, front = figure.subplots(1, parts)
    figure.suptitle(f"{title}\n{verdict}" if verdict else title, y=0.99, fontsize=11)
    found = "radar points"
    if maps is not None:
        spectrum, angles = before
        found = "detections" if dense is None else "radar points above the noise"
        _draw_spectrum(spectrum, np.asarray(maps.power), maps.radar)
        _draw_azimuths(angles, np.asarray(maps.azimuths), maps.radar)
    clouds = {} if lidar is None else {"LiDAR": lidar[lidar[:, 0] > 0]}
    for name, drawn in ((found, cloud), ("jradar", dense)):
        if drawn is not None:
            clouds[name] = surest_last(drawn)
    for name, xyz in clouds.items():
        clouds[name] = xyz[np.linalg.norm(xyz[:, :3], axis=1) <= image.max_range_m]
    _draw_above(above, clouds)
    if polar is not None:
        _draw_polar(front, polar, image.max_range_m)
        return figure
    if metres is None:
        metres = np.asarray(project(dense or cloud, image))
    picture = _draw_image(front, metres, image)
    _add_bar(front, picture, "range (m)")
    shown = f"the {found}" if dense is None else "jradar's cloud"
    front.set_title(f"range image of {shown}")
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


def _draw_azimuths(axes: Axes, power, radar):
    """Draw power [range, azimuth] over degrees; the colours ignore the leakage."""
    sines, _ = direction_sines(radar, num_azimuth=power.shape[1])
    seen = np.abs(sines) <= 1
    level = 10 * np.log10(power[:, seen] + power.max() * 1e-12 + 1e-30)
    distance = radar.range_resolution_m * np.arange(len(power))
    beyond = level[distance >= min(MIN_RANGE_M, distance[-1])]
    picture = axes.pcolormesh(
        np.degrees(np.arcsin(sines[seen])),
        distance,
        level,
        vmin=np.percentile(level, 5),
        vmax=beyond.max(),
    )
    _add_bar(axes, picture, "power (dB)")
    axes.set(title="range-azimuth map", xlabel="azimuth (degrees)", ylabel="range (m)")
    axes.invert_xaxis()


def _add_bar(axes: Axes, picture, label: str):
    """Draw the colours of a picture below its axes."""
    place = axes.inset_axes((0, -0.23, 1, 0.04))
    axes.figure.colorbar(picture, cax=place, orientation="horizontal", label=label)


def surest_last(cloud: PointCloud) -> Float[np.ndarray, "shown column"]:
    """Return the valid points, the surest last; a fourth column is the confidence."""
    valid = np.asarray(cloud.valid)
    xyz = np.asarray(cloud.xyz)[valid]
    if cloud.confidence is None:
        return xyz
    confidence = np.asarray(cloud.confidence)[valid]
    return np.column_stack([xyz, confidence])[np.argsort(confidence)]


def _draw_above(axes: Axes, clouds):
    """Draw clouds from above: x up, y to the left; with confidence as the colour."""
    for name, points in clouds.items():
        colour, size = STYLES[name]
        label = f"{name}: {len(points):,}"
        x, y, _, *confidence = points.T
        if confidence:
            style = {
                "s": size**2,
                "linewidths": 0,
                "cmap": "turbo",
                "vmin": 0,
                "vmax": 1,
                "zorder": 2,
            }
            picture = axes.scatter(y, x, c=confidence[0], label=label, **style)
            _add_bar(axes, picture, "confidence of jradar's points")
            continue
        style = {"linestyle": "", "marker": "o", "markeredgewidth": 0}
        axes.plot(y, x, color=colour, markersize=size, label=label, **style)
    axes.plot(0, 0, "k^")
    axes.set(xlabel="y, left (m), seen from above", ylabel="x, forward (m)")
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_xaxis()
    axes.legend(
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        ncols=1 if len(clouds) > 2 else 2,
        frameon=False,
        columnspacing=1.2,
        handletextpad=0.1,
        labelspacing=0.1,
        borderpad=0,
        fontsize="small",
        markerscale=LEGEND_SIZE,
    )


def _draw_polar(axes: Axes, polar, max_range_m):
    """Draw a polar image [range, azimuth] of 0 to 1, left in the picture is left."""
    view = {"origin": "lower", "aspect": "auto", "extent": (90, -90, 0, max_range_m)}
    picture = axes.imshow(polar[:, ::-1], vmin=0, vmax=1, **view)
    _add_bar(axes, picture, "level, from weakest to strongest")
    axes.set(title="polar image", xlabel="azimuth (degrees)", ylabel="range (m)")


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
