"""Scores on one's own rig: models against the recording's own LiDAR.

    found = score(["walks/home_902"], models=["jradar-sim", "mine"])
    found.describe(), found.write("scores")

Recordings are prepared as for training, and then scored as records are; the folder of
`jradar prepare` can be given instead. There are two truths: the part of the LiDAR that
the radar could have seen, by the rule of training, and, for recordings, all of its
points in the field of view. A model of recordings goes the way of `enhance_recording`;
one in the plane of a row of antennas is compared, as all methods next to it, with what
lies in that plane. Models are compared with OS-CFAR, or with the points that the radar
sent, and with `splat`, the same points smeared. The detector has the false-alarm rate
that is best on the scored frames, which favours it.
"""

import dataclasses
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jradar import data
from jradar.data import PrepareSpec, Records
from jradar.errors import UsageError
from jradar.evaluation.confidence import NO_POINTS
from jradar.evaluation.detectors import (
    OWN_POINTS,
    choose_rates,
    detector_methods,
    point_methods,
)
from jradar.evaluation.methods import Method, Truth, ring_edges, score_rings
from jradar.evaluation.records import (
    TRUTH,
    RecordsInView,
    check_view,
    drawn,
    points_of,
    score_and_keep,
    surest_points,
)
from jradar.evaluation.scored import JUDGED, Score
from jradar.evaluation.tables import pooled
from jradar.lidar import LidarSpec
from jradar.metrics import NEAR_M, near_truth
from jradar.model import FrameGrid, Model, load_model
from jradar.options.protocols import PAPER
from jradar.pipeline import Pipeline, of_model
from jradar.pipeline.warnings import InView
from jradar.radar.angle.spectrum import azimuth_bins
from jradar.range_image import VIEW
from jradar.recordings import Recording
from jradar.types import PointCloud

WHOLE = "whole LiDAR in view"
DETECTORS = ("os",)
SENT = "one that sends points"
SCORED = ("test", "validation")  # splits of records, the first that there is
OWN = ("codec", "validity_threshold", "history")  # fields that models may differ in


def score(
    path: Path | str | Sequence[Path | str],
    *,
    models: Sequence[Path | str] = ("jradar-sim",),
    split: str | None = None,
    frames: slice = slice(None),
    seed: int = 0,
    protocol: str = PAPER,
    **opening: Any,
) -> Score:
    """Score models and the radar's points on recordings, or on one folder of records.

    `split` is that of records, by default test or else validation; `frames` selects
    frames of each recording, `protocol` is one of `jradar.options.protocols`, and
    `opening` are keyword arguments of `open_recording`.
    Raises UsageError for models of other views or radar points than the first, for
    models of samples on points, and for records without the split; ValueError for
    recordings without LiDAR, of radars with other antennas, or in which no LiDAR point
    can be seen.
    """
    paths = [path] if isinstance(path, str | Path) else [*path]
    loaded = {str(name): load_model(name) for name in models}
    first = _alike(loaded)
    if any(map(data.is_records, paths)):
        if len(paths) > 1 or frames != slice(None):
            raise UsageError(
                f"{len(paths)} paths, {frames=}: expected one folder of records, all "
                "of whose frames are scored, or recordings"
            )
        records = _records(paths[0], split)
        check_view(first, records)
        data.pairs_of(first.spec, records)  # refuses a model that sees no points
        methods = {name: drawn(model) for name, model in loaded.items()}
        return _scored(records, loaded, methods, {}, seed, protocol)
    if split is not None:
        raise UsageError(f"{split=}: recordings have no splits, only records do")
    view = {name: getattr(first.spec.frame_grid.view, name) for name in VIEW}
    spec = PrepareSpec(points=first.spec.points, lidar=LidarSpec(**view))
    with tempfile.TemporaryDirectory() as scratch:
        sources = data.find_sources(paths, **opening)
        recordings = {source.name: source.open() for source in sources}
        if any(recording.of_points for recording in recordings.values()):
            _check_points(first)
        data.prepare_sources(sources, scratch, spec, frames=frames, workers=1)

        def whole(frame):
            recording = recordings[frame.prepared.sequence]
            return data.lidar_in_view(recording, frame.prepared, spec.lidar)

        methods = {
            name: _recorded(model, recordings, seed) for name, model in loaded.items()
        }
        truths = {WHOLE: whole}
        return _scored(Records(scratch), loaded, methods, truths, seed, protocol)


def _recorded(model: Model, recordings: dict[str, Recording], seed: int) -> Method:
    """Return the method that enhances a recorded frame, as `enhance_recording` does."""
    pipelines: dict[str, Pipeline] = {}

    def method(key, frame):
        name, number = frame.prepared.sequence, frame.prepared.frame
        recording = recordings[name]
        if name not in pipelines:
            pipelines[name] = Pipeline(recording, model, seed=seed, anyway=True)
        measured, stamp_s = recording.frames[number], frame.prepared.stamp
        return pipelines[name].frame(number, measured, stamp_s).cloud

    return method


def _check_points(model: Model) -> None:
    """Raise UsageError for a model that sees a radar's samples, not its points."""
    grid = model.spec.frame_grid
    jax.eval_shape(lambda points: grid.condition(None, points, None), NO_POINTS)


def _alike(models: dict[str, Model]) -> Model:
    """Return the first model; UsageError for others that see something else."""
    (name, first), *others = models.items()
    wanted = _seen(first)
    for other, model in others:
        for field, value in _seen(model).items():
            if value != wanted[field]:
                raise UsageError(
                    f"--model {other} has {field} = {value}, {name} {wanted[field]}: "
                    "score them one at a time"
                )
    return first


def _seen(model: Model) -> dict[str, Any]:
    """Return what shapes a model's input and view, by name."""
    spec: Any = model.spec
    found: dict[str, Any] = {"grid": spec.grid.kind}
    parts = {"points": spec.points} | vars(spec.grid)
    for name, value in parts.items():
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            fields = dataclasses.asdict(value).items()
            found |= {f"{name}.{field}": each for field, each in fields}
        elif name not in OWN:
            found[name] = value
    bins = "points.num_azimuth"
    if found[bins] is None and model.card.radars:
        found[bins] = azimuth_bins(model.card.radar)
    return found


def _records(folder: Path | str, split: str | None) -> Records:
    """Return the split of records that is scored, or say how to get it."""
    there = {sequence["split"] for sequence in Records(folder).sequences}
    found = split or next((name for name in SCORED if name in there), None)
    if found not in there:
        wanted = split or " or ".join(SCORED)
        raise UsageError(
            f"{folder} has no {wanted} frames, only {', '.join(sorted(there))}: "
            "prepare it again with --test NAME or --validation NAME, or choose --split"
        )
    return Records(folder, found)


def _scored(records, models, answers, truths, seed, protocol) -> Score:
    """Return the scores of the radar's points and of the models' answers on records."""
    first: Model = next(iter(models.values()))
    grid = first.spec.frame_grid
    view = RecordsInView(records, grid.view)
    if not any(len(records[i].lidar_xyz) for i in range(len(records))):
        raise ValueError(
            f"none of {len(records)} frames has a LiDAR point that the radar could "
            "have seen: are the poses of the sensors and their clocks right? `jradar "
            "prepare --preview` draws a frame of them"
        )
    rates: dict[str, float] = {}
    if records.of_points:
        methods = point_methods(view)
    else:
        rates = choose_rates(view, records, detectors=DETECTORS)
        methods = detector_methods(view, rates)
    methods = {k: _compared(method, grid) for k, method in (methods | answers).items()}
    edges, rings, judged = ring_edges(grid.view.max_range_m), [], {}
    near_m = grid.near_m
    sent = InView(first)

    def watch(frame, row, cloud, truth):
        if row["truth"] != TRUTH:
            return
        if row["method"] == OWN_POINTS:
            sent.add(frame.prepared.radar)
        points = surest_points(cloud)
        about = {name: row[name] for name in ("scene", "sequence", "frame", "method")}
        rings.extend(
            about | ring
            for ring in score_rings(points[:, :3], truth, edges=edges, near_m=near_m)
        )
        if row["method"] in models and points.shape[1] > 3 and len(truth):
            right = near_truth(points[:, :3], truth, within_m=near_m)
            judged.setdefault(row["method"], []).append((points[:, 3], right))

    seen = {TRUTH: lambda frame: np.asarray(frame.prepared.lidar_xyz), **truths}
    rows, clouds = score_and_keep(
        jax.random.key(seed),
        view,
        [None] * len(records),  # no method needs images
        methods,
        truths={name: _compared_truth(truth, grid) for name, truth in seen.items()},
        watch=watch,
        protocol=protocol,
        unit=near_m / NEAR_M if protocol == PAPER else 1.0,
    )
    names = [name for name, _ in records.where]
    return Score(
        records={name: names.count(name) for name in dict.fromkeys(names)},
        radar=SENT if records.of_points else records.radar.name,
        models=tuple(models),
        rows=rows,
        rings=rings,
        confidence={
            name: (
                np.concatenate([confidence for confidence, _ in parts]),
                np.concatenate([right for _, right in parts]),
            )
            for name, parts in judged.items()
            if any(len(right) for _, right in parts)
        },
        clouds=clouds,
        view=view,
        notes=(*sent.warnings(), *_notes(records, models, rates, rows)),
        protocol=protocol,
        near_m=near_m,
    )


def _compared(method: Method, grid: FrameGrid) -> Method:
    """Return the method whose clouds are what the grid can be compared in."""
    return lambda key, frame: grid.compared(method(key, frame))


def _compared_truth(truth: Truth, grid: FrameGrid) -> Truth:
    """Return the truth likewise; host."""

    def compared(frame):
        xyz = truth(frame)
        scan: Any = PointCloud(xyz, np.ones(len(xyz), bool))  # pyright: ignore[reportArgumentType]
        return points_of(grid.compared(scan))

    return compared


def _notes(records, models, rates, rows):
    """Yield what to know of the scores, one sentence each."""
    about = data.describe_manifest(records.manifest | {"sequences": records.sequences})
    yield from about["notes"]
    for part in about["dropped"]:
        yield "{sequence}: {frames} frames dropped, {reason}".format(**part)
    for name, model in models.items():
        for warning in of_model(model, records.radar):
            yield f"{name}: {warning}"
    for detector, rate in rates.items():
        yield (
            f"{detector.upper()}-CFAR has a false-alarm rate of {rate:g}, the best on "
            "these frames"
        )
    means = pooled(row for row in rows if row["truth"] == TRUTH)
    if without := means[0]["no_truth"]:
        yield (
            f"{without} frames are left out: the radar could have seen none "
            "of their LiDAR points"
        )
    if not all(np.isfinite(mean[JUDGED].low) for mean in means):
        yield (
            f"{means[0]['frames']} frames are too few for some intervals, which need "
            "four or more that do not resemble each other: record longer"
        )
