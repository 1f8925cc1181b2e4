"""Maps side by side: from above, and from the side."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

SLICE_PERCENT = (0.5, 99.5)  # of the heights that colours tell apart

Points = Float[np.ndarray, "point 3"]


def maps_figure(maps: Mapping[str, Points], *, path: Points | None = None) -> Figure:
    """Draw maps, a column each: from above (x right, y up), and from the side.

    Colour is height, the same in all. `path` is drawn as a line. Raises ValueError
    without points.
    """
    every = np.concatenate([*maps.values()]) if maps else np.zeros((0, 3))
    if not len(every):
        raise ValueError("no points to draw, expected at least one map with points")
    low, high = np.percentile(every, SLICE_PERCENT, axis=0)
    wide, deep, tall = np.maximum(high - low, 1)
    scale = 5 / max(wide, deep)
    width = max(len(maps) * (scale * wide + 0.9) + 1, 4.0)
    height = max(scale * (deep + tall) + 1.8, 4.0)
    figure = Figure(figsize=(width, height), layout="constrained")
    axes: Any = figure.subplots(
        2, len(maps), squeeze=False, sharex=True, height_ratios=(deep, tall)
    )
    picture: Any = None
    for column, (name, points) in enumerate(maps.items()):
        points = points[np.argsort(points[:, 2])]  # the highest on top
        for row, vertical in ((0, 1), (1, 2)):
            panel = axes[row, column]
            picture = panel.scatter(
                points[:, 0],
                points[:, vertical],
                c=points[:, 2],
                s=1.5,
                linewidths=0,
                cmap="turbo",
                vmin=low[2],
                vmax=high[2],
            )
            if path is not None:
                panel.plot(path[:, 0], path[:, vertical], "k-", linewidth=1)
            panel.set_aspect("equal")
            panel.set_xlim(low[0], high[0])
            panel.set_ylim(low[vertical], high[vertical])
        axes[0, column].set_title(f"{name}: {len(points):,} voxels")
        axes[1, column].set_xlabel("x (m)")
    axes[0, 0].set_ylabel("y (m)")
    axes[1, 0].set_ylabel("z (m)")
    figure.colorbar(picture, ax=axes, label="height (m)", shrink=0.75)
    return figure
