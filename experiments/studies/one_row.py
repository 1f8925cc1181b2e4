r"""Does a model of RadarHD's real pairs help a radar with one row of antennas?

    python -m experiments.studies.one_row -o runs/one_row --pairs dataset_5

Units of the second population, with RadarHD's chirp and one row of antennas, stand in
places that the model has never seen. `table.md` compares, in the plane of the antennas,
OS-CFAR's points, the same points smeared, the lit pixels of the polar image, and what
the model makes of that image. The truth is RadarHD's: the LiDAR's points within 0.3 m
of the radar's height. OS-CFAR's rate is chosen in other places.

With `--pairs`, `images.md` compares the values of these polar images with those that
RadarHD published for training.
"""

import dataclasses
import itertools
import sys
import zlib
from argparse import Namespace
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from experiments.command import run_study, study_parser
from experiments.radarhd.pairs import open_radarhd
from jradar.evaluation import (
    markdown,
    markdown_table,
    mean_scores,
    points_of,
    score_frames,
    summarise,
    write_scores,
)
from jradar.evaluation.detectors import RATES, SMEAR_M
from jradar.files import write_text
from jradar.planar import RADAR, PlanarImage, in_plane, true_points
from jradar.radar import PointSpec
from jradar.recordings import Recording, nearest_scan, open_recording
from jradar.session import detect_recording, enhance_recording, load_any_model
from jradar.simulation import draw_unit, simulate_sequence
from jradar.types import PointCloud

FAMILIES = "hallways mine lab outdoor corridor hall home warehouse".split()
CHOICE, SCORED = range(400, 402), range(410, 418)  # seeds of the places
SMEARED = 10_000  # points, about as many as the model draws
EVERY = 12  # of the published images
NEAR_M = 1.0


class Place(NamedTuple):
    """A recording of one frame, and the true points in the plane of its radar."""

    family: str
    seed: int
    recording: Recording
    truth: np.ndarray


def main(argv: list[str] | None = None) -> int:
    """Run the study and return the exit code."""
    parser = study_parser("experiments.studies.one_row", __doc__)
    text = "planar model (default: %(default)s)"
    parser.add_argument("--model", default="radarhd", help=text)
    parser.add_argument("--pairs", help="RadarHD's folder dataset_5, or a packed file")
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Simulate, choose a rate, score, and write the tables."""
    root: Path = options.output
    rate = best_rate([*places(root, CHOICE)])
    rows, images = list[dict[str, Any]](), list[np.ndarray]()
    for place in places(root, SCORED):
        found = clouds(place, options.model, rate, images)
        rows += score_frames(
            jax.random.key(place.seed),
            [found],
            {name: lambda _, found, name=name: found[name] for name in found},
            truths={"plane": lambda _, place=place: place.truth},
            scene=place.family,
            sequence=f"{place.family}_{place.seed}",
            warm_up=False,
        )
    write_scores(root / "frames.jsonl", rows)
    together = summarise(row | {"scene": "all"} for row in rows)
    tables = markdown(together, intervals=True), markdown(summarise(rows))
    text = f"OS-CFAR at a rate of {rate:g}\n\n" + "\n".join(tables)
    write_text(root / "table.md", text)
    if options.pairs:
        pairs = open_radarhd(options.pairs)
        published = [pairs.radar(i) / 255 for i in range(0, len(pairs), EVERY)]
        seen = {"published": published, "simulated": images}
        table = values_table({name: np.stack(each) for name, each in seen.items()})
        write_text(root / "images.md", table)
        text += "\n" + table
    print(text)


def places(root: Path, seeds: Iterable[int]) -> Iterator[Place]:
    """Yield places of every family; those that are not there yet are simulated."""
    for family, seed in itertools.product(FAMILIES, seeds):
        name = f"{family}_{seed}"
        if not (root / "places" / name).is_dir():
            unit = draw_unit(zlib.crc32(name.encode()), population=2)
            unit = dataclasses.replace(unit, one_row=True, waveform="radarhd")
            simulate_sequence(family, seed, root / "places", frames=1, unit=unit)
        recording = open_recording(root / "places" / name)
        scan = np.asarray(nearest_scan(recording, 0))
        yield Place(family, seed, recording, true_points(scan))


def clouds(
    place: Place, model: str, rate: float, images: list[np.ndarray]
) -> dict[str, PointCloud]:
    """Return each method's cloud of a place; append its polar image to `images`."""
    (frame,) = enhance_recording(place.recording, load_any_model(model))
    if not isinstance(frame.image, PlanarImage):
        raise ValueError(f"--model {model}: expected a planar model, such as radarhd")
    images.append(np.asarray(frame.image.radar))
    points, random = detected(place, rate), np.random.default_rng(place.seed)
    chosen = random.integers(max(len(points), 1), size=SMEARED if len(points) else 0)
    found = {
        "OS-CFAR": points,
        "splat": in_plane(random.normal(points[chosen], SMEAR_M)),
        "polar image": RADAR.xyz[images[-1] > 0],
        model: points_of(frame.cloud),
    }
    return {name: PointCloud.from_xyz(xyz) for name, xyz in found.items()}


def detected(place: Place, rate: float) -> np.ndarray:
    """Return OS-CFAR's points in the plane."""
    points = PointSpec(false_alarm_rate=rate)
    (frame,) = detect_recording(place.recording, points=points)
    return in_plane(points_of(frame.points))


def best_rate(chosen: Sequence[Place]) -> float:
    """Return the false-alarm rate of the best mean F-score at 0.2 m."""

    def score(rate):
        found = mean_scores((detected(p, rate) for p in chosen), truths)
        return found["f_score_0.2"]

    truths = [place.truth for place in chosen]
    return max(RATES, key=score)


def values_table(images: dict[str, np.ndarray]) -> str:
    """Return medians and quartiles of polar images [frame, range, azimuth]."""
    columns = []
    for each in images.values():
        lit, whole = (each > 0).mean((1, 2)), (each == 1).any((1, 2))
        near = (each[:, RADAR.ranges < NEAR_M] > 0).any((1, 2))
        strongest = RADAR.ranges[each.max(-1).argmax(-1)]
        columns.append(
            {
                "images": f"{len(each):,}",
                "lit pixels (%)": _quartiles(100 * lit, ".1f"),
                "value of a lit pixel": _quartiles(each[each > 0], ".2f"),
                "range of the strongest (m)": _quartiles(strongest, ".1f"),
                "images with the value 255 (%)": f"{100 * whole.mean():.0f}",
                "images lit within 1 m (%)": f"{100 * near.mean():.0f}",
            }
        )
    rows = ([name, *(column[name] for column in columns)] for name in columns[0])
    return markdown_table(["number", *images], rows)


def _quartiles(values: np.ndarray, form: str) -> str:
    low, middle, high = (format(v, form) for v in np.percentile(values, (25, 50, 75)))
    return f"{middle} ({low}–{high})"


if __name__ == "__main__":
    sys.exit(main())
