"""Pictures of occupancy images in the plane, from above."""

from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from ml_collections import ConfigDict

from experiments.build import SAMPLE_KEY, random_key
from experiments.radarhd.pairs import LIDAR, PolarItems, RadarHD, polar_to_points
from experiments.radarhd.scores import CHOSEN_BY, Draw, Limits, Rows

SHOWN = 4  # frames in a picture


def picture(
    config: ConfigDict,
    pairs: RadarHD,
    draws: dict[str, Draw],
    limits: Limits,
    index: Sequence[int] | None = None,
) -> Figure:
    """Return radar, truth and each method's points from above.

    Of the pairs `index`, by default a few that are evenly spaced.
    """
    if index is None:
        index = np.linspace(0, len(pairs) - 1, SHOWN).astype(int).tolist()
    items = PolarItems(pairs, history=config.data.history)
    condition = jnp.asarray(np.stack([items[i].condition for i in index]))
    key = random_key(config, SAMPLE_KEY)
    names = [f"{pairs[i].trajectory}, frame {pairs[i].frame}" for i in index]
    columns = {"LiDAR": [polar_to_points(pairs[i].lidar) for i in index]}
    for name, draw in draws.items():
        images = np.asarray(draw(key, condition))
        limit = limits["polar"][name]
        columns[name] = [polar_to_points(image > limit) for image in images]
    return plane_figure(
        np.asarray(condition[..., 0]),
        columns,
        max_range_m=LIDAR.max_range_m,
        names=names,
    )


def worst_frames(rows: Rows, method: str, *, number: int = SHOWN) -> list[tuple]:
    """Return trajectory and frame of a method's worst frames, the worst first.

    The score is the F-score at 0.2 m of the Cartesian protocol; one frame is taken from
    each trajectory, since neighbouring frames are alike.
    """
    mine = [
        row
        for row in rows
        if (row["protocol"], row["method"]) == ("cartesian", method)
        and not np.isnan(row[CHOSEN_BY])
    ]
    worst: dict[int, tuple] = {}
    for row in sorted(mine, key=lambda row: row[CHOSEN_BY]):
        worst.setdefault(row["trajectory"], (row["trajectory"], row["frame"]))
    return [*worst.values()][:number]


def worst_picture(
    config: ConfigDict,
    pairs: RadarHD,
    draws: dict[str, Draw],
    limits: Limits,
    rows: Rows,
) -> Figure:
    """Return the picture of the last method's worst frames."""
    places = [tuple(key) for key in pairs.keys.tolist()]
    worst = worst_frames(rows, [*draws][-1])
    index = [places.index(place) for place in worst]
    return picture(config, pairs, draws, limits, index)


def plane_figure(
    radar: Float[np.ndarray, "frame range azimuth"],
    clouds: Mapping[str, Sequence[np.ndarray]],
    *,
    max_range_m: float,
    names: Sequence[str] = (),
) -> Figure:
    """Draw polar radar images and clouds of the same frames in the plane, from above.

    A row for each frame, a column for each name of `clouds`; forward is up. Images have
    ranges from 0 to `max_range_m` and azimuths from -90 to 90 degrees. `names` are
    written beside the rows.
    """
    rows, columns = len(radar), 1 + len(clouds)
    figure = Figure(figsize=(3.2 * columns, 1.9 * rows + 0.4), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    distance, azimuth = np.meshgrid(
        np.linspace(0, max_range_m, radar.shape[1]),
        np.linspace(-np.pi / 2, np.pi / 2, radar.shape[2]),
        indexing="ij",
    )
    for row, image in enumerate(radar):
        axes[row, 0].pcolormesh(
            distance * np.sin(azimuth),
            distance * np.cos(azimuth),
            np.asarray(image),
            cmap="magma",
            shading="gouraud",
            rasterized=True,
        )
        for axis, found in zip(axes[row, 1:], clouds.values(), strict=True):
            axis.plot(found[row][:, 1], found[row][:, 0], ".", ms=1.2, color="black")
    for axis, name in zip(axes[:, 0], names, strict=False):
        axis.set_ylabel(name, fontsize=8)
    for axis, name in zip(axes[0], ("radar", *clouds), strict=True):
        axis.set_title(name, fontsize=9)
    for axis in axes.flat:
        axis.set(
            aspect="equal", xlim=(max_range_m, -max_range_m), ylim=(0, max_range_m)
        )
    figure.supxlabel("left and right (m)", fontsize=9)
    figure.supylabel("forward (m)", fontsize=9)
    return figure
