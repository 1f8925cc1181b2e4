"""Methods on records: what they are given, their rows, and the report of a run.

A method is a function from a key and a `MethodInput` to a PointCloud. `write_results`
scores a dictionary of methods, and writes

    evaluation/frames.jsonl    every score of every frame; all else is made from it
    evaluation/table.*, report.html, clouds.npz, samples.png, ...
"""

import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, Unpack

import jax
import numpy as np
from matplotlib.figure import Figure

from jradar import data, viz
from jradar.errors import UsageError
from jradar.evaluation.methods import (
    Method,
    Truth,
    Watch,
    in_larger_view,
    score_frames,
)
from jradar.evaluation.protocols import PROTOCOLS
from jradar.evaluation.report import ABOUT, build_report, save_clouds
from jradar.evaluation.scores import Scores, write_scores
from jradar.evaluation.statistics import spread
from jradar.evaluation.tables import overview, write_tables
from jradar.files import write_text
from jradar.model import Model, enhance_points
from jradar.options.drawing import Drawing
from jradar.options.protocols import PAPER, PROTOCOLS as DEFINITIONS
from jradar.progress import progress
from jradar.radar import PointSpec, RadarSpec
from jradar.range_image import VIEW, ImageSpec, unproject
from jradar.types import PointCloud

CLOUDS_IN_REPORT = 18
SCENES_IN_FIGURE = 6
TRUTH = "LiDAR"  # the part that the radar could have seen
Clouds = dict[tuple[str, str, int], dict[str, np.ndarray]]  # by frame and name


class MethodInput(NamedTuple):
    """What a method is given: the prepared frame and its images."""

    prepared: data.PreparedFrame
    pair: data.Pair | None


class RecordsInView(NamedTuple):
    """Records, and an image of the field of view in which their points count."""

    records: data.Records
    fine: ImageSpec

    def radar_of(self, prepared: data.PreparedFrame) -> RadarSpec:
        """Return the radar that recorded a frame."""
        return self.records.radar_of(prepared.sequence)

    def points(self, prepared: data.PreparedFrame, **options: Any) -> PointSpec:
        """Return the spec for the cells of a frame, with the windows of its spectra."""
        doppler, range_ = self.records.windows_of(prepared.sequence)
        chosen = {"doppler_window": doppler, "range_window": range_, **options}
        return PointSpec(**chosen).fitted(self.radar_of(prepared))


def records_in_view(records: data.Records) -> RecordsInView:
    """Return the records and a 128 x 512 image of their field of view."""
    seen = records.manifest["options"]["lidar"]
    angles = tuple(seen["azimuth"]), tuple(seen["elevation"])
    return RecordsInView(records, ImageSpec(128, 512, *angles, seen["max_range_m"]))


def points_of(cloud: PointCloud) -> np.ndarray:
    """Return the valid points of a cloud."""
    return np.asarray(cloud.xyz)[np.asarray(cloud.valid)]


def surest_points(cloud: PointCloud) -> np.ndarray:
    """Return the valid points, with the cloud's confidence as a fourth column.

    A cloud without confidence has three columns.
    """
    xyz = points_of(cloud)
    if cloud.confidence is None:
        return xyz
    confidence = np.asarray(cloud.confidence)[np.asarray(cloud.valid)]
    return np.column_stack([xyz, np.clip(confidence, 0, 1)])  # rounding may pass 1


def scene_of(sequence: str) -> str:
    """Return the scene under which a sequence is scored."""
    try:
        return data.scene(sequence)
    except ValueError:
        return sequence.rpartition("_")[0] or sequence


def check_view(model: Model, records: data.Records) -> None:
    """Raise UsageError for records of another field of view than the model's."""
    lidar, fine = records.manifest["options"]["lidar"], model.spec.frame_grid.view
    seen = {name: np.ravel(lidar[name]).tolist() for name in VIEW}
    wanted = {name: np.ravel(getattr(fine, name)).tolist() for name in VIEW}
    if seen != wanted:
        raise UsageError(
            f"{records.folder} was prepared for the view {seen}, the model has "
            f"{wanted}: prepare it again with --spec and these values in [lidar], or "
            "fine-tune a model in this view: `jradar finetune --own-view`"
        )


def drawn(model: Model, **drawing: Unpack[Drawing]) -> Method:
    """Return the method that draws the model's cloud with options of `draw`."""
    return lambda key, frame: enhance_points(
        key, frame.prepared.radar, model, **drawing
    )


def write_results(
    key: jax.Array,
    workdir: Path,
    view: RecordsInView,
    pairs: Any,
    methods: dict[str, Method],
    *,
    every: int = 1,
    about: str = "",
    protocol: str = PAPER,
) -> None:
    """Score methods on every `every`-th frame of each sequence, and print the tables.

    The report begins with `about`, a sentence on the frames, and shows the clouds of
    some of them, spread over all. Scores are those of a `protocol` of `PROTOCOLS`.
    """
    options = {"every": every, "protocol": protocol}
    rows, clouds = score_and_keep(key, view, pairs, methods, **options)
    if protocol != PAPER:
        about = f"{about} Protocol {protocol}: {DEFINITIONS[protocol]}.".strip()
    figures = {"samples": samples(clouds, view.fine)}
    report = write_report(workdir, rows, clouds, figures, about=about)
    print(f"{overview(rows)}\nreport: {report}")


def score_and_keep(
    key: jax.Array,
    view: RecordsInView,
    pairs: Any,
    methods: dict[str, Method],
    *,
    every: int = 1,
    watch: Watch | None = None,
    **options: Any,
) -> tuple[Scores, Clouds]:
    """Return the rows of `score_records`, and the clouds of some of all frames."""
    scored = [i for index in _scored(view.records, every).values() for i in index]
    shown = {
        view.records.where[scored[i]] for i in spread(len(scored), CLOUDS_IN_REPORT)
    }
    clouds: Clouds = {}

    def keep(frame, row, cloud, truth):
        if watch is not None:
            watch(frame, row, cloud, truth)
        place = frame.prepared.sequence, frame.prepared.frame
        if place in shown and row["truth"] == TRUTH:
            named = clouds.setdefault((row["scene"], *place), {})
            if not view.records.of_points:  # which are those of a method
                named.setdefault("radar", points_of(frame.prepared.radar))
            named[row["method"]] = surest_points(cloud)
            named[TRUTH] = np.asarray(named.pop(TRUTH, truth))  # LiDAR comes last

    options |= {"every": every, "watch": keep}
    return [*score_records(key, view, pairs, methods, **options)], clouds


def write_report(
    workdir: Path,
    rows: Iterable[dict[str, Any]],
    clouds: Mapping[tuple[str, str, int], Mapping[str, np.ndarray]],
    figures: Mapping[str, Figure],
    *,
    about: str = "",
) -> Path:
    """Write scores, their tables, clouds and figures, and return the report's path.

    `clouds` are by scene, sequence and frame, and by name. The report begins with the
    sentence `about`.
    """
    out = workdir / "evaluation"
    write_text(out / ABOUT, f"{about}\n")
    write_scores(out / "frames.jsonl", rows)
    write_tables(out / "frames.jsonl")
    save_clouds(out / "clouds.npz", clouds)
    for name, figure in figures.items():
        viz.save_figure(figure, out / f"{name}.png")
    return build_report(workdir)


def score_records(
    key: jax.Array,
    view: RecordsInView,
    pairs: Any,
    methods: dict[str, Method],
    *,
    every: int = 1,
    only: str | None = None,
    truths: Mapping[str, Truth] | None = None,
    watch: Watch | None = None,
    protocol: str = PAPER,
    unit: float = 1.0,
    advance: Callable[..., None] | None = None,
) -> Iterator[dict[str, Any]]:
    """Yield scores of methods on every `every`-th frame of each sequence, or of `only`.

    `unit` is as in `in_larger_view`. `advance` is called with the number of frames of
    all sequences so far; by default progress is shown.
    By default there are two truths: the prepared LiDAR cloud, and that cloud after its
    range image. A row's `frame` is the number of the radar frame in its recording.
    """
    truths = truths or {
        TRUTH: lambda frame: frame.prepared.lidar_xyz,
        "LiDAR as an image": lambda frame: points_of(
            unproject(frame.pair.lidar, view.fine)
        ),
    }
    records, done, compiled = view.records, 0, set()
    scored = _scored(records, every)
    total = sum(map(len, scored.values()))
    with (
        progress("scoring", total, unit="frames")
        if advance is None
        else contextlib.nullcontext(advance)
    ) as show:
        for number, (sequence, index) in enumerate(scored.items()):
            if only not in (None, sequence):
                done += len(index)
                continue
            rows = score_frames(
                jax.random.fold_in(key, number),
                (MethodInput(records[i], pairs[i]) for i in index),
                methods,
                truths=truths,
                scene=scene_of(sequence),
                sequence=sequence,
                size=lambda frame: len(frame.prepared.radar.valid),
                compiled=compiled,
                watch=watch,
                scored=in_larger_view(PROTOCOLS[protocol], unit),
            )
            for row in rows:
                yield row | {"frame": records.where[index[row["frame"]]][1]}
                show(done + row["frame"] + 1, sequence)
            done += len(index)


def _scored(records: data.Records, every: int) -> dict[str, list[int]]:
    """Indices of the frames that are scored, by sequence."""
    found: dict[str, list[int]] = {}
    for i, (sequence, _) in enumerate(records.where):
        found.setdefault(sequence, []).append(i)
    return {sequence: index[::every] for sequence, index in found.items()}


def samples(clouds: Clouds, fine: ImageSpec) -> Figure:
    """Draw the range images of the first frame of each scene."""
    scenes: dict[str, dict[str, np.ndarray]] = {}
    for (scene, _, _), named in clouds.items():
        scenes.setdefault(scene, named)
    first = [*scenes.values()][:SCENES_IN_FIGURE]
    columns = {
        name: np.stack([data.lidar_image(named[name][:, :3], fine) for named in first])
        for name in first[0]
    }
    return viz.samples_figure(columns, fine)
