r"""CFAR detectors on records: the rows that every method is compared with.

    python -m experiments.studies.detectors RECORDS -o runs/detectors

Each detector has the false-alarm rate that serves it best on the validation split; the
scores are those of the test split. Only points in the view for which the records were
prepared count, as for the truth.

Records hold one direction for each cell. Rows of MUSIC's directions come from the same
recordings, prepared again with a file that says `angles = "music"` (`jradar prepare
--spec FILE`): the power and the truth of these records are the same.
"""

import argparse
import functools
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from jradar import data, evaluation
from jradar.lidar import shared_field_of_view
from jradar.metrics import compare_on_host
from jradar.progress import progress
from jradar.radar import DETECTORS, PointSpec, RadarSpec, cell_points, detect
from jradar.range_image import ImageSpec, unproject
from jradar.types import PointCloud

RATES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8)  # of false alarms, to choose from
Method = Callable[[jax.Array, "Frame"], PointCloud]


class Frame(NamedTuple):
    """What a method is given: the prepared frame and its images."""

    prepared: data.PreparedFrame
    pair: data.Pair | None


class View(NamedTuple):
    """The radar, and the image whose field of view counts."""

    radar: RadarSpec
    fine: ImageSpec


def view_of(records: data.Records) -> View:
    """The records' radar, and the paper's image of the view they were prepared for."""
    seen = records.manifest["options"]["lidar"]
    fine = ImageSpec(
        128,
        512,
        azimuth=tuple(seen["azimuth"]),
        elevation=tuple(seen["elevation"]),
        max_range_m=seen["max_range_m"],
    )
    return View(records.radar, fine)


def detector_methods(
    view: View, rates: dict[str, float], *, angles: str = "fft"
) -> dict[str, Method]:
    """A CFAR detector each, at its false-alarm rate, seen in the model's view.

    `angles` is how the records' directions were found: "fft" goes without saying.
    """
    suffix = "" if angles == "fft" else f", {angles.upper()}"
    return {
        f"{detector.upper()}-CFAR{suffix}": functools.partial(
            detected, view=view, detector=detector, rate=rate
        )
        for detector, rate in rates.items()
    }


def choose_rates(
    view: View,
    records: data.Records,
    *,
    detectors: tuple[str, ...] = tuple(DETECTORS),
    frames: int = 48,
) -> dict[str, float]:
    """The false-alarm rate at which each detector has its best F-score at 0.2 m."""
    index = np.linspace(0, len(records) - 1, min(frames, len(records))).astype(int)
    prepared = [records[int(i)] for i in index]
    chosen = {}
    for detector in detectors:
        scores = {
            rate: np.mean([_f_score(view, detector, rate, frame) for frame in prepared])
            for rate in RATES
        }
        chosen[detector] = max(scores, key=lambda rate: scores[rate])
    return chosen


def _f_score(view, detector, rate, prepared):
    """F-score at 0.2 m of a detector on a frame; 0 where it finds nothing."""
    frame = Frame(prepared, None)
    return f_score(
        detected(None, frame, view=view, detector=detector, rate=rate), prepared
    )


def f_score(cloud: PointCloud, prepared: data.PreparedFrame) -> float:
    """F-score at 0.2 m against a frame's LiDAR; 0 where either cloud is empty."""
    xyz, truth = points_of(cloud), prepared.lidar_xyz
    if not len(xyz) or not len(truth):
        return 0.0
    return float(compare_on_host(xyz, truth).f_score[1])


def detected(_, frame, *, view, detector, rate):
    """Points of a detector within the model's view."""
    points = PointSpec(detector=detector, false_alarm_rate=rate).fitted(view.radar)
    mask = detect(frame.prepared.cells.power, view.radar, points=points)
    return seen_points(frame.prepared, mask, view)


def seen_points(prepared: data.PreparedFrame, mask: Any, view: View) -> PointCloud:
    """Points of a frame's cells in `mask` that lie within the model's view."""
    cloud = cell_points(
        prepared.cells,
        mask,
        view.radar,
        points=PointSpec().fitted(view.radar),
        range_bias_m=prepared.range_bias_m,
    )
    seen = shared_field_of_view(
        np.asarray(cloud.xyz),
        azimuth=view.fine.azimuth,
        elevation=view.fine.elevation,
        max_range_m=view.fine.max_range_m,
    )
    return cloud._replace(valid=np.asarray(cloud.valid) & seen)


def score_records(
    key: jax.Array,
    view: View,
    records: data.Records,
    pairs: Any,
    methods: dict[str, Method],
    *,
    every: int = 1,
) -> Iterator[dict[str, Any]]:
    """Scores of methods on every so many frames of all sequences, one after the other.

    The truth is the prepared LiDAR cloud, and the same cloud after its range image.
    """
    truths = {
        "LiDAR": lambda frame: frame.prepared.lidar_xyz,
        "LiDAR as an image": lambda frame: points_of(
            unproject(frame.pair.lidar, view.fine)
        ),
    }
    names = list(dict.fromkeys(name for name, _ in records.where))
    index = {
        name: [i for i, (n, _) in enumerate(records.where) if n == name][::every]
        for name in names
    }
    with progress("scoring", sum(map(len, index.values())), unit="frames") as show:
        done = 0
        for number, name in enumerate(names):
            frames = _Frames(records, pairs, index[name])
            rows = evaluation.score_frames(
                jax.random.fold_in(key, number),
                frames,
                methods,
                truths=truths,
                scene=scene_of(name),
                sequence=name,
                warm_up=not done,
            )
            for row in rows:
                yield row
                show(done + row["frame"] + 1, name)
            done += len(frames)


class _Frames:
    """Some frames of one sequence."""

    def __init__(self, records, pairs, index):
        self._records, self._pairs, self._index = records, pairs, index

    def __len__(self):
        return len(self._index)

    def __getitem__(self, i):
        return Frame(self._records[self._index[i]], self._pairs[self._index[i]])


def scene_of(name: str) -> str:
    """The scene that a sequence's scores count for."""
    try:
        return data.scene(name)
    except ValueError:
        return name.rpartition("_")[0] or name


def points_of(cloud: PointCloud) -> np.ndarray:
    """The valid points of a cloud."""
    return np.asarray(cloud.xyz)[np.asarray(cloud.valid)]


def main(argv: list[str] | None = None) -> int:
    """Score the detectors on a folder of records; tables and curves."""
    parser = argparse.ArgumentParser(prog="experiments.studies.detectors")
    parser.add_argument("records", help="folder of `jradar prepare`")
    parser.add_argument("-o", "--output", required=True, help="folder for the tables")
    parser.add_argument("--every", type=int, default=1, help="of how many frames one")
    options = parser.parse_args(argv)
    records = data.Records(options.records, "test")
    view = view_of(records)
    rates = choose_rates(view, data.Records(options.records, "validation"))
    pairs = data.PairSource(records, view.fine, view.fine, num_slices=1)
    angles = records.manifest["options"].get("angles", "fft")
    methods = detector_methods(view, rates, angles=angles)
    path = Path(options.output) / "evaluation" / "frames.jsonl"
    rows = score_records(
        jax.random.key(0), view, records, pairs, methods, every=options.every
    )
    evaluation.write_scores(path, rows)
    evaluation.write_tables(path)
    report = evaluation.build_report(options.output)
    print(f"false-alarm rates: {rates}")
    print((path.parent / "table.md").read_text())
    print(f"report: {report}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
