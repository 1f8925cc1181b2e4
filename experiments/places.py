"""Simulate and prepare training frames of many places, see `jradar.simulation.drawn`.

    python -m experiments.places --set=jradar-sim-5 --maps=ColoRadar -o runs/sim5
    python -m experiments.places --set=jradar-sim-5-row -o runs/row --workers 2

`--maps` is a folder of packed runs of ColoRadar's maps; without it there are no frames
of real places. The same command resumes what was interrupted. Configs take the records
as --config.data.path=runs/sim5, and leave kinds out by --config.data.without=KIND,KIND.

The second set consists of polar images in RadarHD's layout, each of a radar with one
row of antennas, and of the radar's points. Training takes it as
--config.data.simulated=runs/row.
"""

import argparse
import functools
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from experiments import build
from experiments.configs import marginal
from experiments.radarhd.pairs import PolarPair, write_pair
from jradar.errors import UsageError
from jradar.model.grids.polar import lidar_image, polar_image
from jradar.progress import progress
from jradar.radar import PointSpec, calibrate, radar_points
from jradar.recordings import nearest_scan
from jradar.simulation.drawn import DRAWN, DrawnSource, row_sources
from jradar.workers import run_jobs

ROW = "jradar-sim-5-row"
COMPLETE = "complete"  # folder of names of sources


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the records of a set, with the points that the shipped model takes."""
    words = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    words.add_argument("--set", default="jradar-sim-5", choices=[*DRAWN, ROW])
    words.add_argument("--maps", default="", help="folder of packed runs")
    words.add_argument("-o", "--output", required=True, type=Path)
    words.add_argument("--workers", default=1, type=int, help="processes")
    chosen = words.parse_args(arguments)
    if chosen.set == ROW:
        write_polar_pairs(row_sources(), chosen.output, workers=chosen.workers)
        return
    config = marginal.get_config()
    config.data.set, config.data.maps = chosen.set, chosen.maps
    build.draw_places(config, chosen.output, workers=chosen.workers)


def write_polar_pairs(
    sources: Sequence[DrawnSource], folder: Path, *, workers: int = 1
) -> None:
    """Write the polar pairs that are missing; a source is a trajectory.

    Raises UsageError for a folder of other files, such as RadarHD's own.
    """
    complete = folder / COMPLETE
    if folder.exists() and any(folder.iterdir()) and not complete.is_dir():
        raise UsageError(f"{folder} holds other files, expected an empty folder")
    complete.mkdir(parents=True, exist_ok=True)
    job = functools.partial(write_source, folder=folder)
    with progress("simulating", len(sources), unit="sources") as show:
        jobs = run_jobs(job, [*enumerate(sources)], workers=workers)
        for done, _ in enumerate(jobs, start=1):
            show(done)


def write_source(numbered: tuple[int, DrawnSource], *, folder: Path) -> None:
    """Write the pairs of a source, unless they are complete.

    Frames in which either image is empty are left out.
    """
    number, source = numbered
    marker = folder / COMPLETE / source.name
    if marker.exists():
        return
    recording = source.open()
    radar = recording.radar
    spec = PointSpec().fitted(radar.spec)
    for frame in range(len(recording.cubes)):
        cube = recording.cube(frame)
        seen = polar_image(calibrate(cube, radar), radar.spec)
        points = radar_points(cube, radar, points=spec)
        xyz = np.asarray(points.xyz)[np.asarray(points.valid)]
        truth = lidar_image(np.asarray(nearest_scan(recording, frame)))
        image = np.rint(255 * np.asarray(seen)).astype(np.uint8)
        if image.any() and truth.any():
            write_pair(folder, PolarPair(image, truth, number, frame, xyz))
    marker.touch()


if __name__ == "__main__":
    main()
