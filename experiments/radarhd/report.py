"""What an evaluation on RadarHD's pairs writes: the shared report, tables, pictures.

`evaluation/protocols.md` has tables for each protocol: over all frames, by building and
by trajectory. The folder's test trajectories are from three buildings.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from ml_collections import ConfigDict

from experiments.radarhd.model import Answers
from experiments.radarhd.pairs import PolarPair, RadarHD
from experiments.radarhd.scores import (
    PROTOCOLS,
    Limits,
    Rows,
    building,
    drawn_images,
    polar_points,
    score_pairs,
)
from jradar import evaluation
from jradar.evaluation import spread, write_report
from jradar.evaluation.scores import FIELDS
from jradar.files import write_text
from jradar.model.grids.polar import MAX_RANGE_M, RADAR

SHOWN = 4  # frames in a picture
NOTES = """\
CD is the mean of the two mean distances. Of polar pixels, distances are means over the
frames in which the method found points; the empty ones count as 0 in the F-scores. On
the Cartesian grid, empty predictions and truths count as the one point (0, 0, 0).
"""
Drawn = list[tuple[PolarPair, dict[str, np.ndarray]]]  # clouds of pairs, by name


def write_results(
    config: ConfigDict,
    workdir: Path,
    title: str,
    pairs: RadarHD,
    answers: Answers,
    limits: Limits,
) -> None:
    """Score methods at their limits; write and print tables, and write the report."""
    every = config.data.every
    rows = [*score_pairs(config, pairs, answers, every=every, limits=limits)]
    frames = len({(row["sequence"], row["frame"]) for row in rows})
    parts = [f"# {title}\n\n{frames} frames, one in {every}.\n"]
    parts += [protocol_tables(rows, protocol, limits) for protocol in PROTOCOLS]
    text = "\n".join([*parts, NOTES])
    write_text(workdir / "evaluation" / "protocols.md", text)
    index = {"samples": spread(len(pairs), SHOWN), "worst": worst_frames(pairs, rows)}
    drawn = {
        name: draw_clouds(config, pairs, answers, limits, places)
        for name, places in index.items()
    }
    path = write_report(
        workdir,
        [{field: row[field] for field in FIELDS} for row in rows],
        {place_of(pair): clouds for part in drawn.values() for pair, clouds in part},
        {name: plane_figure(part) for name, part in drawn.items()},
    )
    print(f"{text}\nreport: {path}")


def summary(rows: Rows, field: str = "") -> list[dict[str, Any]]:
    """Return each method's means with intervals, for each value of a row's field."""
    together = [row | {"scene": row[field] if field else "all"} for row in rows]
    return evaluation.summarise(together)


def protocol_tables(rows: Rows, protocol: str, limits: Limits) -> str:
    """Return the tables of a protocol: limits, all frames, buildings, trajectories."""
    rows = [row for row in rows if row["truth"] == protocol]
    chosen = [f"{method}: {limit:.2f}" for method, limit in limits[protocol].items()]
    parts = [f"## Protocol `{protocol}`\n\nLimits of {'; '.join(chosen)}.\n"]
    for field in ("", "scene", "sequence"):
        if not field or len({row[field] for row in rows}) > 1:
            parts += [evaluation.markdown(summary(rows, field), intervals=True)]
    if left_out := summary(rows)[0]["no_truth"]:
        parts += [f"{left_out} frames with an empty truth are left out.\n"]
    return "\n".join(parts)


def worst_frames(pairs: RadarHD, rows: Rows) -> list[int]:
    """Return the pairs that the last method draws worst, the worst first.

    The score is the F-score at 0.2 m of the Cartesian protocol; one frame is taken from
    each trajectory, since neighbouring frames are alike.
    """
    last = "cartesian", rows[-1]["method"]
    mine = [row for row in rows if (row["truth"], row["method"]) == last]
    worst: dict[str, list[int]] = {}
    for row in sorted(mine, key=lambda row: row["f_score_0.2"]):
        worst.setdefault(row["sequence"], [int(row["sequence"]), row["frame"]])
    return [pairs.keys.tolist().index(key) for key in worst.values()][:SHOWN]


def place_of(pair: PolarPair) -> tuple[str, str, int]:
    """Return the scene, the sequence and the frame of a pair."""
    return building(pair.trajectory), str(pair.trajectory), pair.frame


def draw_clouds(
    config: ConfigDict,
    pairs: RadarHD,
    answers: Answers,
    limits: Limits,
    index: Sequence[int],
) -> Drawn:
    """Return the pairs of an index with the points of the LiDAR and of each method."""
    found: dict[tuple, tuple[PolarPair, dict[str, np.ndarray]]] = {}
    for pair, name, image in drawn_images(config, pairs, answers, index):
        start = pair, {"LiDAR": polar_points(pair.lidar)}
        _, clouds = found.setdefault(place_of(pair), start)
        clouds[name] = polar_points(image > limits["polar"][name])
    return [*found.values()]


def plane_figure(drawn: Drawn) -> Figure:
    """Return a figure of radar images and clouds in the plane, from above.

    A row for each pair, a column for each name of clouds; forward is up.
    """
    names = ("radar", *drawn[0][1])
    size = 3.2 * len(names), 1.9 * len(drawn) + 0.4
    figure = Figure(figsize=size, layout="constrained")
    shared = {"squeeze": False, "sharex": True, "sharey": True}
    axes = figure.subplots(len(drawn), len(names), **shared)
    distance, azimuth = np.meshgrid(RADAR.ranges, RADAR.angles, indexing="ij")
    left, ahead = distance * np.sin(azimuth), distance * np.cos(azimuth)
    look = {"cmap": "magma", "shading": "gouraud", "rasterized": True}
    for row, (pair, clouds) in zip(axes, drawn, strict=True):
        row[0].pcolormesh(left, ahead, pair.radar, **look)
        row[0].set_ylabel(f"{pair.trajectory}, frame {pair.frame}", fontsize=8)
        for axis, points in zip(row[1:], clouds.values(), strict=True):
            axis.plot(points[:, 1], points[:, 0], ".", ms=1.2, color="black")
    for axis, name in zip(axes[0], names, strict=True):
        axis.set_title(name, fontsize=9)
    for axis in axes.flat:
        axis.set(aspect="equal", ylim=(0, MAX_RANGE_M))
        axis.set(xlim=(MAX_RANGE_M, -MAX_RANGE_M))
    figure.supxlabel("left and right (m)", fontsize=9)
    figure.supylabel("forward (m)", fontsize=9)
    return figure
