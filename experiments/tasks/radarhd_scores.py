"""Scores of occupancy images in the plane: limits, table, picture.

One rule holds for frames without points, as in `jradar.evaluation.tables`: a frame in
which a method found nothing has no distances and F-scores of 0, and is counted as
`empty`; a frame with an empty truth has no scores and is left out.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from ml_collections import ConfigDict

from experiments.build import SAMPLE_KEY, random_key
from experiments.tables import known_mean, markdown_table
from experiments.tasks.radarhd_pairs import LIDAR, PolarItems, RadarHD, polar_to_points
from jradar import evaluation, viz
from jradar.files import write_text
from jradar.metrics import THRESHOLDS_M, compare_on_host

# Limits of the drawn value to choose from: evenly spaced log-odds.
LIMITS = 1 / (1 + np.exp(-np.arange(-5.0, 4.1, 0.25)))
CHOSEN_BY = "f_score_0.2"
SHOWN = 4  # frames in the picture
COLUMNS = {  # of the table: score, title, scale, digits
    "chamfer": ("Chamfer (m)", 1, 3),
    "modified_hausdorff": ("MHD (m)", 1, 3),
    **{f"f_score_{limit}": (f"F {limit} m (%)", 100, 1) for limit in THRESHOLDS_M},
}
Draw = Callable[[jax.Array, jax.Array], jax.Array]
Rows = list[dict[str, Any]]


def write_polar_results(
    config: ConfigDict,
    workdir: Path,
    title: str,
    pairs: RadarHD,
    draws: dict[str, Draw],
    limits: dict[str, float],
) -> None:
    """Score methods at their limits; write scores, table and picture."""
    every = config.data.every
    rows = [*score_pairs(config, pairs, draws, every=every, limits=limits)]
    out = workdir / "evaluation"
    write_text(out / "frames.jsonl", "".join(json.dumps(row) + "\n" for row in rows))
    table = f"{title}\n\n{markdown(rows, limits)}"
    write_text(out / "table.md", table)
    viz.save_figure(picture(config, pairs, draws, limits), out / "samples.png")
    print(f"{table}\nwritten to {out}")


def score_pairs(
    config: ConfigDict,
    pairs: RadarHD,
    draws: dict[str, Draw],
    *,
    every: int = 1,
    limits: dict[str, float] | None = None,
) -> Iterator[dict[str, Any]]:
    """Yield scores of each method on every `every`-th pair, at its limit or at LIMITS.

    As RadarHD defines them, in metres: `chamfer` is the mean of the two mean distances,
    `modified_hausdorff` the larger of the two medians.
    """
    items = PolarItems(pairs, history=config.data.history)
    index = np.arange(0, len(pairs), every)
    key, size = random_key(config, SAMPLE_KEY), config.sampling.batch_size
    for first in range(0, len(index), size):
        part = index[first : first + size]
        padded = np.resize(part, size)  # one shape, compiled once
        condition = jnp.asarray(np.stack([items[i].condition for i in padded]))
        for name, draw in draws.items():
            images = np.asarray(draw(jax.random.fold_in(key, first), condition))
            for image, i in zip(images, part, strict=False):
                pair = pairs[int(i)]
                truth = polar_to_points(pair.lidar)
                for limit in LIMITS if limits is None else [limits[name]]:
                    found = polar_to_points(image > limit)
                    yield {
                        "method": name,
                        "trajectory": pair.trajectory,
                        "frame": pair.frame,
                        "limit": float(limit),
                        "points": len(found),
                        **plane_scores(found, truth),
                    }


def plane_scores(found: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """Return the scores of one frame; without points, by the rule of this module."""
    if not len(truth):
        return dict.fromkeys(COLUMNS, np.nan)
    if not len(found):
        return {name: 0.0 if name.startswith("f_") else np.nan for name in COLUMNS}
    scores = compare_on_host(found, truth)
    values = (scores.chamfer / 2, scores.modified_hausdorff, *scores.f_score)
    return {name: float(v) for name, v in zip(COLUMNS, values, strict=True)}


def choose_limits(rows: Iterable[dict[str, Any]]) -> dict[str, float]:
    """Return the limit of each method with the best mean F-score at 0.2 m."""
    scores: dict[str, dict[float, list[float]]] = {}
    for row in rows:
        limits = scores.setdefault(row["method"], {})
        limits.setdefault(row["limit"], []).append(row[CHOSEN_BY])
    return {
        method: max(limits, key=lambda limit, found=limits: known_mean(found[limit]))
        for method, limits in scores.items()
    }


def mean_scores(rows: Rows) -> dict[str, float]:
    """Return the mean scores and the share of frames in which nothing was found."""
    means = {name: known_mean([row[name] for row in rows]) for name in COLUMNS}
    return {**means, "empty": known_mean([not row["points"] for row in rows])}


def markdown(rows: Rows, limits: dict[str, float]) -> str:
    """Return a table of means with 95 % intervals that allow for correlated frames."""
    scores = [title for title, _, _ in COLUMNS.values()]
    titles = ["method", "limit", *scores, "frames", "empty"]
    lines, left_out = [], 0
    for method, limit in limits.items():
        every = [row for row in rows if row["method"] == method]
        mine = [row for row in every if not np.isnan(row[CHOSEN_BY])]
        left_out = len(every) - len(mine)
        trajectories = sorted({row["trajectory"] for row in mine})
        cells = [method, f"{limit:.2f}"]
        for name, (_, scale, digits) in COLUMNS.items():
            estimate = evaluation.mean_interval(
                [
                    [row[name] for row in mine if row["trajectory"] == trajectory]
                    for trajectory in trajectories
                ]
            )
            mean, low, high = (
                f"{scale * value:.{digits}f}"
                for value in (estimate.mean, estimate.low, estimate.high)
            )
            cells.append(f"{mean} ({low} to {high})")
        empty = sum(not row["points"] for row in mine)
        lines.append([*cells, str(len(mine)), str(empty)])
    note = (
        "Distances are means over the frames in which the method found points; the "
        "`empty` ones count as 0 in the F-scores."
    )
    if left_out:
        note += f" {left_out} frames with an empty truth are left out."
    return f"{markdown_table(titles, lines)}\n{note}\n"


def picture(
    config: ConfigDict,
    pairs: RadarHD,
    draws: dict[str, Draw],
    limits: dict[str, float],
) -> Figure:
    """Return radar, truth and each method's points from above, for a few frames."""
    items = PolarItems(pairs, history=config.data.history)
    index = np.linspace(0, len(pairs) - 1, SHOWN).astype(int).tolist()
    condition = jnp.asarray(np.stack([items[i].condition for i in index]))
    key = random_key(config, SAMPLE_KEY)
    columns = {"LiDAR": [polar_to_points(pairs[i].lidar) for i in index]}
    for name, draw in draws.items():
        images = np.asarray(draw(key, condition))
        columns[name] = [polar_to_points(image > limits[name]) for image in images]
    return plane_figure(
        np.asarray(condition[..., 0]), columns, max_range_m=LIDAR.max_range_m
    )


def plane_figure(
    radar: Float[np.ndarray, "frame range azimuth"],
    clouds: Mapping[str, Sequence[np.ndarray]],
    *,
    max_range_m: float,
) -> Figure:
    """Draw polar radar images and clouds of the same frames in the plane, from above.

    A row for each frame, a column for each name of `clouds`; forward is up. Images have
    ranges from 0 to `max_range_m` and azimuths from -90 to 90 degrees.
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
    for axis, name in zip(axes[0], ("radar", *clouds), strict=True):
        axis.set_title(name, fontsize=9)
    for axis in axes.flat:
        axis.set(
            aspect="equal", xlim=(max_range_m, -max_range_m), ylim=(0, max_range_m)
        )
    figure.supxlabel("left and right (m)", fontsize=9)
    figure.supylabel("forward (m)", fontsize=9)
    return figure
