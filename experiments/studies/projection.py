r"""How much of the clouds survives their range images (the paper's study, IV-B).

    python -m experiments.studies.projection RECORDS -o runs/projection

A cloud is projected to images of a size, one for each slice of the range axis, and
comes back as one point at the centre of each pixel. The table holds the distance
between the two clouds, and the share of the points that are left: of the LiDAR's cloud,
which the target is made of, and of the radar's, the condition's.
"""

import argparse
import csv
import io
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator

from experiments.studies.detectors import points_of, view_of
from jradar import data, viz
from jradar.files import write_text
from jradar.metrics import THRESHOLDS_M, compare_on_host
from jradar.progress import progress
from jradar.range_image import ImageSpec, pixel_of, project_slices, unproject
from jradar.types import PointCloud

SIZES = {
    "LiDAR": ((32, 128), (64, 256), (96, 384), (128, 512), (192, 768), (256, 1024)),
    "radar": ((16, 16), (32, 32), (64, 64), (128, 128), (256, 256)),
}
SLICES = (1, 2, 4, 8, 16)
SCORES = ("chamfer", *(f"f_score_{limit}" for limit in THRESHOLDS_M), "kept")


def round_trip(
    xyz: np.ndarray, image: ImageSpec, *, num_slices: int
) -> tuple[np.ndarray, np.ndarray]:
    """The points that lie in the image's view, and those that come back from it."""
    size = 1 << max(len(xyz) - 1, 0).bit_length()  # few sizes to compile
    padded = np.zeros((size, 3), np.float32)
    padded[: len(xyz)] = xyz
    cloud = PointCloud(jnp.asarray(padded), jnp.arange(size) < len(xyz))
    images = project_slices(cloud, image, num_slices=num_slices).range_m
    back = unproject(jnp.moveaxis(images, -1, 0), image)
    *_, inside = pixel_of(cloud.xyz, image)
    inside = np.asarray(inside)[: len(xyz)]
    return xyz[inside], points_of(
        jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), back)
    )


def study(records: data.Records, *, frames: int) -> Iterator[dict[str, Any]]:
    """A row of scores for each frame, cloud, image size and number of slices."""
    view = view_of(records).fine
    index = np.linspace(0, len(records) - 1, min(frames, len(records))).astype(int)
    with progress("projecting", len(index), unit="frames") as show:
        for done, i in enumerate(index):
            frame = records[int(i)]
            clouds = {"LiDAR": frame.lidar_xyz, "radar": points_of(frame.radar)}
            for name, xyz in clouds.items():
                for height, width in SIZES[name]:
                    image = ImageSpec(
                        height, width, view.azimuth, view.elevation, view.max_range_m
                    )
                    for num_slices in SLICES:
                        before, after = round_trip(xyz, image, num_slices=num_slices)
                        if not len(before):
                            continue
                        scores = compare_on_host(after, before)
                        values = (scores.chamfer, *scores.f_score)
                        kept = len(after) / len(before)
                        yield {
                            "cloud": name,
                            "size": f"{height}x{width}",
                            "slices": num_slices,
                            **dict(zip(SCORES, (*values, kept), strict=True)),
                        }
            show(done + 1)


def mean_rows(rows: list[dict[str, Any]], keys: tuple[str, ...]) -> list[dict]:
    """Means of all numbers over the rows that agree in `keys`, in order; `frames`."""
    groups: dict[tuple, list] = {}
    for row in rows:
        groups.setdefault(tuple(row[key] for key in keys), []).append(row)
    return [
        dict(zip(keys, group, strict=True))
        | {"frames": len(members)}
        | {
            name: float(np.nanmean([member[name] for member in members]))
            for name in members[0]
            if name not in keys
        }
        for group, members in groups.items()
    ]


def markdown(means: list[dict]) -> str:
    """Means as a table, distances in centimetres and shares in percent."""
    scores = " | ".join(f"F {limit} m (%)" for limit in THRESHOLDS_M)
    head = f"| cloud | image | slices | Chamfer (cm) | {scores} | kept (%) | frames |"
    lines = [head, "|---" * (head.count("|") - 1) + "|"]
    for row in means:
        cells = [row["cloud"], row["size"], str(row["slices"])]
        cells += [f"{100 * row[name]:.1f}" for name in SCORES]
        lines.append("| " + " | ".join([*cells, str(row["frames"])]) + " |")
    return "\n".join(lines) + "\n"


def curves_figure(
    panels: dict[str, dict[str, list[tuple[float, float]]]],
    *,
    xlabel: str,
    ylabels: list[str],
) -> Figure:
    """An axis for each panel, and in it a named line of (x, y); x doubles by ticks."""
    figure = Figure(figsize=(4.6 * len(panels), 3.8), layout="constrained")
    axes_row = figure.subplots(1, len(panels), squeeze=False)[0]
    for axes, (title, lines), label in zip(
        axes_row, panels.items(), ylabels, strict=True
    ):
        for name, points in lines.items():
            axes.plot(*zip(*points, strict=True), marker="o", label=name)
        ticks = sorted({x for points in lines.values() for x, _ in points})
        axes.set(title=title, xlabel=xlabel, ylabel=label, xscale="log")
        axes.set_ylim(bottom=0)
        axes.xaxis.set_major_locator(FixedLocator(ticks))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set_xticklabels([f"{x:g}" for x in ticks])
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    handles, labels = axes_row[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=6, frameon=False)
    return figure


def csv_text(rows: list[dict[str, Any]]) -> str:
    """Rows as CSV."""
    text = io.StringIO()
    writer = csv.DictWriter(text, [*rows[0]], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def main(argv: list[str] | None = None) -> int:
    """Study a split of records; table, CSV and figure."""
    parser = argparse.ArgumentParser(
        prog="experiments.studies.projection", description=__doc__
    )
    parser.add_argument("records", help="folder of `jradar prepare`")
    parser.add_argument("-o", "--output", required=True, help="folder for the tables")
    parser.add_argument("--split", default="validation", help="default validation")
    parser.add_argument("--frames", type=int, default=48, help="of the split (48)")
    options = parser.parse_args(argv)
    records = data.Records(options.records, options.split)
    rows = [*study(records, frames=options.frames)]
    means = mean_rows(rows, ("cloud", "size", "slices"))
    folder = Path(options.output)
    write_text(folder / "table.md", markdown(means))
    write_text(folder / "table.csv", csv_text(means))
    panels: dict[str, dict[str, list]] = {}
    for row in means:
        lines = panels.setdefault(row["cloud"], {})
        line = lines.setdefault(f"{row['slices']} slice{'s' * (row['slices'] > 1)}", [])
        line.append((int(row["size"].split("x")[1]), 100 * row["chamfer"]))
    figure = curves_figure(
        panels,
        xlabel="columns of the image",
        ylabels=["Chamfer distance to the original (cm)"] * len(panels),
    )
    viz.save_figure(figure, folder / "projection.png")
    print(f"{(folder / 'table.md').read_text()}\nwritten to {folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
