"""Simulated frames beside real ones, drawn alike."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from jradar.radar import RadarSpec
from jradar.viz.figures import _draw_above, _draw_spectrum


class Seen(NamedTuple):
    """What a radar saw: one map and its points, and polar images with LiDAR points."""

    power: Float[np.ndarray, "doppler range"]
    xyz: Float[np.ndarray, "point 3"]
    images: Float[np.ndarray, "frame range azimuth"]  # 0 to 1, over equal angles
    lidar: list[np.ndarray]  # of each image, `[point, 2]` in metres, x forward, y left
    names: tuple[str, ...] = ()  # of the images


def realism_figure(
    rows: Mapping[str, Seen], radar: RadarSpec, *, max_range_m: float
) -> Figure:
    """A row for each name: map, points from above, polar images under LiDAR points.

    Images hold ranges from 0 to `max_range_m` and azimuths from -90 to 90 degrees.
    """
    columns = 2 + max(len(seen.images) for seen in rows.values())
    wide = [1.0, 0.9, *[1.7] * (columns - 2)]
    figure = Figure(figsize=(2.7 * sum(wide), 3.1 * len(rows)), layout="constrained")
    axes = figure.subplots(
        len(rows), columns, squeeze=False, gridspec_kw={"width_ratios": wide}
    )
    reach = radar.max_range_m
    for row, (name, seen) in zip(axes, rows.items(), strict=True):
        _draw_spectrum(row[0], seen.power, radar)
        row[0].set_title(f"{name}: range and velocity")
        _draw_above(row[1], {"radar": seen.xyz})
        row[1].get_legend().remove()
        row[1].set(title=f"{name}: points from above")
        row[1].set(xlim=(reach / 2, -reach / 2), ylim=(0, reach))
        distance, azimuth = np.meshgrid(
            np.linspace(0, max_range_m, seen.images.shape[1]),
            np.linspace(-np.pi / 2, np.pi / 2, seen.images.shape[2]),
            indexing="ij",
        )
        for axis in row[2 + len(seen.images) :]:
            axis.set_axis_off()
        names = seen.names or tuple(f"pair {k}" for k in range(len(seen.images)))
        drawn = zip(row[2:], seen.images, seen.lidar, names, strict=False)
        for axis, image, lidar, title in drawn:
            left, ahead = distance * np.sin(azimuth), distance * np.cos(azimuth)
            axis.pcolormesh(
                *(left, ahead, image),
                cmap="magma",
                vmin=0,
                vmax=1,
                shading="gouraud",
                rasterized=True,
            )
            axis.plot(lidar[:, 1], lidar[:, 0], ".", ms=1.5, color="deepskyblue")
            axis.set(xlim=(max_range_m, -max_range_m), ylim=(0, max_range_m))
            axis.set(aspect="equal", title=f"{name}: {title}, LiDAR in blue")
    return figure
