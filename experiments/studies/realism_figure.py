"""A figure of simulated frames beside real ones."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jradar.radar import RadarSpec


class Row(NamedTuple):
    """One kind of frame: a map with its points, and polar images with LiDAR points."""

    power: Float[np.ndarray, "doppler range"]
    xyz: Float[np.ndarray, "point 3"]
    images: Float[np.ndarray, "frame range azimuth"]  # 0 to 1, over equal angles
    lidar: list[np.ndarray]  # of each image, `[point, 2]` in metres, x forward, y left
    names: tuple[str, ...] = ()  # of the images


def realism_figure(
    rows: Mapping[str, Row], radar: RadarSpec, *, max_range_m: float
) -> Figure:
    """Return a figure with a row for each name.

    A row shows the map, the points from above, and polar images under LiDAR points.
    Images cover ranges from 0 to `max_range_m` and azimuths from -90 to 90 degrees.
    """
    columns = 2 + max(len(row.images) for row in rows.values())
    widths = [1.0, 0.9, *[1.7] * (columns - 2)]
    figure = Figure(figsize=(2.7 * sum(widths), 3.1 * len(rows)), layout="constrained")
    grid = figure.subplots(
        len(rows), columns, squeeze=False, gridspec_kw={"width_ratios": widths}
    )
    for axes, (name, row) in zip(grid, rows.items(), strict=True):
        _draw_map(axes[0], row.power, radar)
        axes[0].set_title(f"{name}: range and velocity")
        _draw_above(axes[1], row.xyz, radar.max_range_m)
        axes[1].set_title(f"{name}: points from above")
        for axis in axes[2 + len(row.images) :]:
            axis.set_axis_off()
        names = row.names or tuple(f"pair {k}" for k in range(len(row.images)))
        drawn = zip(axes[2:], row.images, row.lidar, names, strict=False)
        for axis, image, lidar, title in drawn:
            _draw_polar(axis, image, lidar, max_range_m)
            axis.set_title(f"{name}: {title}, LiDAR in blue")
    return figure


def _draw_map(axes: Axes, power, radar):
    """Power in decibels over velocity and range."""
    level = 10 * np.log10(power + power.max() * 1e-12)
    velocity, distance = radar.max_velocity_mps, radar.max_range_m
    axes.imshow(
        level.T,
        origin="lower",
        aspect="auto",
        extent=(-velocity, velocity, 0, distance),
        vmin=np.percentile(level, 5),
    )
    axes.set(xlabel="velocity (m/s)", ylabel="range (m)")


def _draw_above(axes: Axes, xyz, reach):
    """Radar points from above: forward is up, left is left."""
    axes.scatter(xyz[:, 1], xyz[:, 0], s=6, c="tab:red", linewidths=0)
    axes.plot(0, 0, "k^")
    axes.set(xlim=(reach / 2, -reach / 2), ylim=(0, reach), aspect="equal")
    axes.set(xlabel="y, left (m)", ylabel="x, forward (m)")


def _draw_polar(axes: Axes, image, lidar, max_range_m):
    """A polar image in the plane, and LiDAR points on it."""
    distance, azimuth = np.meshgrid(
        np.linspace(0, max_range_m, image.shape[0]),
        np.linspace(-np.pi / 2, np.pi / 2, image.shape[1]),
        indexing="ij",
    )
    axes.pcolormesh(
        *(distance * np.sin(azimuth), distance * np.cos(azimuth), image),
        cmap="magma",
        vmin=0,
        vmax=1,
        shading="gouraud",
        rasterized=True,
    )
    axes.plot(lidar[:, 1], lidar[:, 0], ".", ms=1.5, color="deepskyblue")
    axes.set(xlim=(max_range_m, -max_range_m), ylim=(0, max_range_m), aspect="equal")
