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

import contextlib
import dataclasses
import functools
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from jradar import data
from jradar.data import PrepareSpec, Records
from jradar.data.sources import Source
from jradar.errors import UsageError
from jradar.evaluation.confidence import NO_POINTS
from jradar.evaluation.detectors import (
    choose_rates,
    detector_methods,
    point_methods,
)
from jradar.evaluation.methods import Method, Truth, ring_edges, score_rings
from jradar.evaluation.records import (
    TRUTH,
    Clouds,
    RecordsInView,
    check_view,
    drawn,
    points_of,
    score_and_keep,
    surest_points,
)
from jradar.evaluation.scored import JUDGED, Score
from jradar.evaluation.scores import Scores
from jradar.evaluation.tables import pooled
from jradar.lidar import LidarSpec
from jradar.metrics import NEAR_M, near_truth
from jradar.model import FrameGrid, Model, load_model
from jradar.options.models import absolute_model
from jradar.options.protocols import PAPER
from jradar.pipeline import Pipeline, of_model
from jradar.pipeline.warnings import InView
from jradar.progress import progress
from jradar.radar.angle.spectrum import azimuth_bins
from jradar.range_image import VIEW
from jradar.recordings import Recording
from jradar.types import PointCloud
from jradar.workers import run_jobs

WHOLE = "whole LiDAR in view"
DETECTORS = ("os",)
SENT = "one that sends points"
SCORED = ("test", "validation")  # splits of records, the first that there is
OWN = ("codec", "validity_threshold", "history")  # fields that models may differ in


class _Task(NamedTuple):
    """What a process needs to score the sequences of some records."""

    folder: Path | str
    split: str | None
    models: dict[str, str]  # names and places, as of `absolute_model`
    seed: int
    protocol: str
    sources: Mapping[str, Source] = {}  # of recordings, none of records alone
    rates: dict[str, float] = {}  # of false alarms, by detector


class _Found(NamedTuple):
    """The scores of one sequence, and the clouds of some of its frames."""

    rows: Scores
    clouds: Clouds
    rings: Scores
    judged: dict[str, list[tuple[np.ndarray, np.ndarray]]]  # confidence, what is right


def score(
    path: Path | str | Sequence[Path | str],
    *,
    models: Sequence[Path | str] = ("jradar-sim",),
    split: str | None = None,
    frames: slice = slice(None),
    seed: int = 0,
    protocol: str = PAPER,
    workers: int = 1,
    scheduler: str | None = None,
    **opening: Any,
) -> Score:
    """Score models and the radar's points on recordings, or on one folder of records.

    `split` is that of records, by default test or else validation; `frames` selects
    frames of each recording, `protocol` is one of `jradar.options.protocols`, and
    `opening` are keyword arguments of `open_recording`. Several recordings are scored
    by `workers` or a `scheduler`, as in `run_jobs`; the machines of a cluster must see
    the same files, also those in TMPDIR.
    Raises UsageError for models of other views or radar points than the first, for
    models of samples on points, and for records without the split; ValueError for
    recordings without LiDAR, of radars with other antennas, or in which no LiDAR point
    can be seen.
    """
    paths = [path] if isinstance(path, str | Path) else [*path]
    loaded = {str(name): load_model(name) for name in models}
    first = _alike(loaded)
    folders = {name: absolute_model(name) for name in loaded}
    if any(map(data.is_records, paths)):
        if len(paths) > 1 or frames != slice(None):
            raise UsageError(
                f"{len(paths)} paths, {frames=}: expected one folder of records, all "
                "of whose frames are scored, or recordings"
            )
        folder, split = Path(paths[0]).absolute(), _split(paths[0], split)
        task = _Task(folder, split, folders, seed, protocol)
        records = Records(task.folder, task.split)
        check_view(first, records)
        data.pairs_of(first.spec, records)  # refuses a model that sees no points
        return _scored(task, loaded, workers, scheduler)
    if split is not None:
        raise UsageError(f"{split=}: recordings have no splits, only records do")
    with tempfile.TemporaryDirectory() as scratch:
        sources = data.find_sources(paths, **opening)
        if any(source.open().of_points for source in sources):
            _check_points(first)
        data.prepare_sources(
            sources,
            scratch,
            PrepareSpec(points=first.spec.points, lidar=_lidar(first)),
            frames=frames,
            workers=workers,
            scheduler=scheduler,
        )
        task = _Task(scratch, None, folders, seed, protocol)
        named = {source.name: source for source in sources}
        return _scored(task._replace(sources=named), loaded, workers, scheduler)


def _lidar(model: Model) -> LidarSpec:
    """Return the preparation of scans in the model's view."""
    return LidarSpec(
        **{name: getattr(model.spec.frame_grid.view, name) for name in VIEW}
    )


def _recorded(model: Model, recording: Recording, seed: int) -> Method:
    """Return the method that enhances a recorded frame, as `enhance_recording` does."""
    pipeline = Pipeline(recording, model, seed=seed, anyway=True)

    def method(key, frame):
        number, stamp_s = frame.prepared.frame, frame.prepared.stamp
        return pipeline.frame(number, recording.frames[number], stamp_s).cloud

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


def _split(folder: Path | str, split: str | None) -> str:
    """Return the split of records that is scored, or say how to get it."""
    there = {sequence["split"] for sequence in Records(folder).sequences}
    found = split or next((name for name in SCORED if name in there), "")
    if found not in there:
        wanted = split or " or ".join(SCORED)
        raise UsageError(
            f"{folder} has no {wanted} frames, only {', '.join(sorted(there))}: "
            "prepare it again with --test NAME or --validation NAME, or choose --split"
        )
    return found


def _scored(
    task: _Task, models: dict[str, Model], workers: int, scheduler: str | None
) -> Score:
    """Return the scores of the radar's points and of models on records."""
    records, first = Records(task.folder, task.split), next(iter(models.values()))
    view = RecordsInView(records, first.spec.frame_grid.view)
    if not any(len(frame.lidar_xyz) for frame in records):
        raise ValueError(
            f"none of {len(records)} frames has a LiDAR point that the radar could "
            "have seen: are the poses of the sensors and their clocks right? `jradar "
            "prepare --preview` draws a frame of them"
        )
    sent = InView(first)
    if records.of_points:
        for frame in records:
            sent.add(frame.radar)
    else:
        task = task._replace(rates=choose_rates(view, records, detectors=DETECTORS))
    counts = Counter(name for name, _ in records.where)
    found, workers = dict[str, _Found](), min(workers, len(counts))
    here = scheduler is None and workers == 1
    with progress("scoring", len(records), unit="frames") as show:
        held = {"models": models, "advance": show} if here else {}
        call = functools.partial(_score_sequence, task, **held)
        jobs = run_jobs(call, [*counts], workers=workers, scheduler=scheduler)
        with contextlib.closing(jobs):
            for name, part in jobs:
                found[name] = part
                show(sum(counts[name] for name in found), name)
    parts = [found[name] for name in counts]
    rows = [row for part in parts for row in part.rows]
    return Score(
        records=dict(counts),
        radar=SENT if records.of_points else records.radar.name,
        models=tuple(models),
        rows=rows,
        rings=[ring for part in parts for ring in part.rings],
        confidence=_joined(part.judged for part in parts),
        clouds={key: cloud for part in parts for key, cloud in part.clouds.items()},
        view=view,
        notes=(*sent.warnings(), *_notes(records, models, task.rates, rows)),
        protocol=task.protocol,
        near_m=first.spec.frame_grid.near_m,
    )


def _score_sequence(
    task: _Task,
    sequence: str,
    *,
    models: dict[str, Model] | None = None,
    advance: Callable[..., None] | None = None,
) -> _Found:
    """Return the scores of a sequence; another process loads the models itself."""
    models = models or {k: load_model(place) for k, place in task.models.items()}
    records, first = Records(task.folder, task.split), next(iter(models.values()))
    grid = first.spec.frame_grid
    view, near_m = RecordsInView(records, grid.view), grid.near_m
    answers = {name: drawn(model) for name, model in models.items()}
    truths: dict[str, Truth] = {
        TRUTH: lambda frame: np.asarray(frame.prepared.lidar_xyz)
    }
    if task.sources:
        recording = task.sources[sequence].open()
        answers = {k: _recorded(m, recording, task.seed) for k, m in models.items()}
        lidar = _lidar(first)
        truths[WHOLE] = lambda frame: data.lidar_in_view(
            recording, frame.prepared, lidar
        )
    if records.of_points:
        methods = point_methods(view) | answers
    else:
        methods = detector_methods(view, task.rates) | answers
    edges, rings, judged = ring_edges(grid.view.max_range_m), [], {}

    def watch(frame, row, cloud, truth):
        if row["truth"] != TRUTH:
            return
        points = surest_points(cloud)
        about = {name: row[name] for name in ("scene", "sequence", "frame", "method")}
        rings.extend(
            about | ring
            for ring in score_rings(points[:, :3], truth, edges=edges, near_m=near_m)
        )
        if row["method"] in models and points.shape[1] > 3 and len(truth):
            right = near_truth(points[:, :3], truth, within_m=near_m)
            judged.setdefault(row["method"], []).append((points[:, 3], right))

    rows, clouds = score_and_keep(
        jax.random.key(task.seed),
        view,
        [None] * len(records),  # no method needs images
        {name: _compared(method, grid) for name, method in methods.items()},
        only=sequence,
        truths={name: _compared_truth(truth, grid) for name, truth in truths.items()},
        watch=watch,
        protocol=task.protocol,
        unit=near_m / NEAR_M if task.protocol == PAPER else 1.0,
        advance=advance or (lambda *_: None),
    )
    return _Found(rows, clouds, rings, judged)


def _joined(
    judged: Iterable[dict[str, list[tuple[np.ndarray, np.ndarray]]]],
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return the confidence of all points, and which are right, by the model's name."""
    parts: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for found in judged:
        for name, frames in found.items():
            parts.setdefault(name, []).extend(frames)
    return {
        name: (
            np.concatenate([confidence for confidence, _ in frames]),
            np.concatenate([right for _, right in frames]),
        )
        for name, frames in parts.items()
        if any(len(right) for _, right in frames)
    }


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
