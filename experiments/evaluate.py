"""What an evaluation leaves in a workdir: scores, tables, clouds, pictures, report."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np

from experiments.studies.detectors import (
    Frame,
    Method,
    View,
    points_of,
    scene_of,
    score_records,
)
from jradar import data, evaluation, viz

CLOUDS_IN_REPORT = 18
SCENES_IN_FIGURE = 6

Place = tuple[str, int]  # sequence, frame of its radar


def write_results(
    key: jax.Array,
    workdir: Path,
    view: View,
    records: data.Records,
    pairs: Any,
    methods: dict[str, Method],
    *,
    every: int = 1,
) -> None:
    """Score methods on every so many frames of each sequence; prints the tables.

    Clouds of some frames, spread over all of them, are kept for the report.
    """
    out = workdir / "evaluation"
    scored = _scored(records, every)
    places = [place for sequence in scored.values() for place in sequence]
    index = np.linspace(0, len(places) - 1, min(CLOUDS_IN_REPORT, len(places)))
    shown = [places[int(i)] for i in index]
    drawn: dict[tuple[Place, str], Any] = {}
    watched = {n: _watched(n, m, {*shown}, drawn) for n, m in methods.items()}
    rows = score_records(key, view, records, pairs, watched, every=every)
    evaluation.write_scores(out / "frames.jsonl", _numbered(rows, scored))
    evaluation.write_tables(out / "frames.jsonl")

    clouds = {}
    for name, number in shown:
        prepared = records[records.where.index((name, number))]
        found = {m: points_of(drawn[(name, number), m]) for m in methods}
        clouds[scene_of(name), name, number] = {
            "radar": points_of(prepared.radar),
            **found,
            "LiDAR": np.asarray(prepared.lidar_xyz),
        }
    evaluation.save_clouds(out / "clouds.npz", clouds)
    viz.save_figure(_samples(clouds, view), out / "samples.png")
    report = evaluation.build_report(workdir)
    scores = evaluation.read_scores(out / "frames.jsonl")
    print(f"{evaluation.overview(scores)}\nreport: {report}")


def _scored(records: data.Records, every: int) -> dict[str, list[Place]]:
    """Frames that are scored, by sequence, in the order of `score_records`."""
    places: dict[str, list[Place]] = {}
    for name, number in records.where:
        places.setdefault(name, []).append((name, number))
    return {name: found[::every] for name, found in places.items()}


def _watched(name: str, method: Method, shown: set[Place], drawn: dict) -> Method:
    """The method, whose clouds of the frames that are shown are kept in `drawn`."""

    def call(key: jax.Array, frame: Frame):
        cloud = method(key, frame)
        if (place := (frame.prepared.sequence, frame.prepared.frame)) in shown:
            drawn[place, name] = cloud
        return cloud

    return call


def _numbered(rows, scored: dict[str, list[Place]]) -> Iterator[dict[str, Any]]:
    """Rows with the radar's number of a frame in the place of the scored one's."""
    for row in rows:
        yield row | {"frame": scored[row["sequence"]][row["frame"]][1]}


def _samples(clouds, view: View):
    """Range images of the first frame of each scene."""
    scenes: dict[str, dict[str, np.ndarray]] = {}
    for (scene, _, _), named in clouds.items():
        scenes.setdefault(scene, named)
    first = [*scenes.values()][:SCENES_IN_FIGURE]
    columns = {
        name: np.stack([data.lidar_image(named[name], view.fine) for named in first])
        for name in first[0]
    }
    return viz.samples_figure(columns, view.fine)
