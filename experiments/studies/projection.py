r"""Measure how much of a cloud survives its range images (the paper's IV-B).

    python -m experiments.studies.projection RECORDS -o runs/projection

A cloud is projected to images of a size, one for each slice of the range axis, and
unprojected to one point at the centre of each pixel. The table contains the distance
between the two clouds and the share of the points that remain, for the LiDAR cloud (the
target) and for the radar cloud (the condition).
"""

import sys
from argparse import Namespace
from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from experiments.command import run_study, study_parser
from experiments.evaluate import points_of, spread, view_of
from experiments.tables import (
    csv_text,
    curves_figure,
    markdown_table,
    mean_rows,
)
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
SCORES = {  # and their titles; distances in centimetres, shares in percent
    "chamfer": "Chamfer (cm)",
    **{f"f_score_{limit}": f"F {limit} m (%)" for limit in THRESHOLDS_M},
    "kept": "kept (%)",
}


def main(argv: list[str] | None = None) -> int:
    """Run the study and return the exit code."""
    parser = study_parser("projection", __doc__)
    parser.add_argument("records", help="folder of `jradar prepare`")
    parser.add_argument("--split", default="validation", help="default: validation")
    parser.add_argument("--frames", type=int, default=48, help="default: 48")
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Project frames of a split, and write table, CSV and figure."""
    records = data.Records(options.records, options.split)
    rows = [*frame_rows(records, frames=options.frames)]
    means = mean_rows(rows, ("cloud", "size", "slices"))
    out = options.output
    table = markdown(means)
    write_text(out / "table.md", table)
    write_text(out / "table.csv", csv_text(means))
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
    viz.save_figure(figure, out / "projection.png")
    print(f"{table}\nwritten to {out}")


def frame_rows(records: data.Records, *, frames: int) -> Iterator[dict[str, Any]]:
    """Yield scores of each frame, cloud, image size and number of slices."""
    view = view_of(records).fine
    index = spread(len(records), frames)
    with progress("projecting", len(index), unit="frames") as show:
        for done, i in enumerate(index):
            frame = records[i]
            clouds = {"LiDAR": frame.lidar_xyz, "radar": points_of(frame.radar)}
            for name, xyz in clouds.items():
                for height, width in SIZES[name]:
                    image = ImageSpec(
                        height, width, view.azimuth, view.elevation, view.max_range_m
                    )
                    for num_slices in SLICES:
                        scores = survival(xyz, image, num_slices=num_slices)
                        if scores:
                            yield {
                                "cloud": name,
                                "size": f"{height}x{width}",
                                "slices": num_slices,
                                **scores,
                            }
            show(done + 1)


def survival(xyz: np.ndarray, image: ImageSpec, *, num_slices: int) -> dict[str, float]:
    """Return the scores of a round trip; nothing for a cloud outside the view."""
    before, after = round_trip(xyz, image, num_slices=num_slices)
    if not len(before):
        return {}
    scores = compare_on_host(after, before)
    values = (scores.chamfer, *scores.f_score, len(after) / len(before))
    return dict(zip(SCORES, values, strict=True))


def round_trip(
    xyz: np.ndarray, image: ImageSpec, *, num_slices: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points in the image's view, and the points that its images give."""
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


def markdown(means: list[dict]) -> str:
    """Return the means as a Markdown table."""
    rows = [
        [row["cloud"], row["size"], str(row["slices"])]
        + [f"{100 * row[name]:.1f}" for name in SCORES]
        + [str(row["frames"])]
        for row in means
    ]
    return markdown_table(
        ["cloud", "image", "slices", *SCORES.values(), "frames"], rows
    )


if __name__ == "__main__":
    sys.exit(main())
