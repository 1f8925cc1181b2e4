"""Maps side by side, or one cloud: from above, and from the side."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from jradar.types import PointCloud, check_one_cloud

SLICE_PERCENT = (0.5, 99.5)  # of the points that fit, and of the heights in colours

Points = Float[np.ndarray, "point 3"]


def show(cloud: PointCloud) -> Figure:
    """Draw one cloud from above (x right, y up), and from the side.

    Colour is confidence, or height if the cloud has none. A notebook shows the figure,
    `save_figure` writes it. Raises ValueError without points.
    """
    check_one_cloud(cloud, "show")
    valid = np.asarray(cloud.valid)
    confidence = cloud.confidence
    if confidence is not None:
        confidence = np.asarray(confidence)[valid]
    return _draw({"cloud": np.asarray(cloud.xyz)[valid]}, "points", None, confidence)


def maps_figure(
    maps: Mapping[str, Points], *, path: Points | None = None, title: str = ""
) -> Figure:
    """Draw maps, a column each: from above (x right, y up), and from the side.

    Colour is height, the same in all. `path` is drawn as a line. Raises ValueError
    without points.
    """
    figure = _draw(maps, "voxels", path)
    figure.suptitle(title)
    return figure


def _draw(maps, noun, path, confidence=None) -> Figure:
    """Draw clouds; `confidence` of the points of the only one is their colour."""
    every = np.concatenate([*maps.values()]) if maps else np.zeros((0, 3))
    if not len(every):
        raise ValueError("no points to draw, expected at least one map with points")
    low, high = np.percentile(every, SLICE_PERCENT, axis=0)
    if path is not None:
        low, high = np.minimum(low, path.min(0)), np.maximum(high, path.max(0))
    wide, deep, tall = np.maximum(high - low, 1)
    scale = 5 / max(wide, deep)
    width = max(len(maps) * (scale * wide + 0.9) + 1, 4.0)
    height = max(scale * (deep + tall) + 1.8, 4.0)
    figure = Figure(figsize=(width, height), layout="constrained")
    axes: Any = figure.subplots(
        2, len(maps), squeeze=False, sharex=True, height_ratios=(deep, tall)
    )
    picture: Any = None
    lowest, highest = (low[2], high[2]) if confidence is None else (0.0, 1.0)
    for column, (name, points) in enumerate(maps.items()):
        colours = points[:, 2] if confidence is None else confidence
        order = np.argsort(colours)  # the highest, or the surest, on top
        points, colours = points[order], colours[order]
        for row, vertical in ((0, 1), (1, 2)):
            panel = axes[row, column]
            picture = panel.scatter(
                points[:, 0],
                points[:, vertical],
                c=colours,
                s=1.5,
                linewidths=0,
                cmap="turbo",
                vmin=lowest,
                vmax=highest,
            )
            if path is not None:
                panel.plot(path[:, 0], path[:, vertical], "k-", linewidth=1)
            panel.set_aspect("equal")
            panel.set_xlim(low[0], high[0])
            panel.set_ylim(low[vertical], high[vertical])
        axes[0, column].set_title(f"{name}: {len(points):,} {noun}")
        axes[1, column].set_xlabel("x (m)")
    axes[0, 0].set_ylabel("y (m)")
    axes[1, 0].set_ylabel("z (m)")
    label = "height (m)" if confidence is None else "confidence"
    figure.colorbar(picture, ax=axes, label=label, shrink=0.75)
    return figure
