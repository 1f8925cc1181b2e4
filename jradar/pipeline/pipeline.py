"""The steps from a radar's frames to clouds, once for recordings and live radars.

    cube, or points that the radar sent
         --observe--> samples, points, condition
         --answer---> image, with the frames before it where the model or `fuse` asks
         --cloud----> PointCloud
         --judge----> Frame, with warnings

`Pipeline.frame` takes all steps. For several threads, call the steps one by one, each
for all frames in their order.
"""

import dataclasses
import functools
import math
import re
from collections.abc import Iterator
from typing import Any, NamedTuple, Unpack

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Inexact

from jradar.errors import UsageError
from jradar.model import Model
from jradar.model.fusion import view_grid
from jradar.options.drawing import Drawing, given
from jradar.pipeline import warnings
from jradar.pipeline.fusion import LastFrames
from jradar.pipeline.history import LastImages, check_history, frame_times
from jradar.pipeline.stages import Measured, Observed, Stages, Stopwatch
from jradar.pipeline.together import LastPoints
from jradar.radar import PointSpec
from jradar.recordings import Recording
from jradar.types import PointCloud

Detections = tuple[
    Float[Array, "doppler range"] | None, Bool[Array, "doppler range"] | None
]


class Frame(NamedTuple):
    """One frame of a radar, enhanced; points that it sent have no samples."""

    number: int
    stamp_s: float | None  # None if its time is not known
    samples: Inexact[Array, "tx rx chirp sample"] | None  # calibrated, cleaned
    power: Float[Array, "doppler range"] | None  # None if nobody asked for it
    detected: Bool[Array, "doppler range"] | None  # above the noise, 1 in 1,000 false
    points: PointCloud  # of the radar
    image: Any  # as `draw` returns it
    cloud: PointCloud
    confidence: float | None  # mean over the image's points; None if it has none
    unlikeness: float | None  # share of training frames that are more usual
    warnings: tuple[str, ...]

    @property
    def empty(self) -> bool:
        """True if the radar saw nothing."""
        return not np.asarray(self.points.valid).any()

    @property
    def bare(self) -> bool:
        """True if the radar saw something, but the cloud has no point."""
        return not (self.empty or np.asarray(self.cloud.valid).any())

    @property
    def pixels(self) -> Bool[np.ndarray, "row column"]:
        """Which pixels of the image are points of the cloud, which begins with them."""
        shape = np.shape(self.image[0])
        valid = np.asarray(self.cloud.valid)[: math.prod(shape)]
        return valid.reshape(shape)

    @property
    def verdict(self) -> tuple[str, ...]:
        """How far to trust the cloud, in sentences: in pictures and files."""
        sure = self.confidence
        share = () if sure is None else (f"{sure:.0%} of its points may be right",)
        firsts = (re.split(r": |\. ", text)[0] for text in self.warnings)
        return (*share, *firsts)

    def describe(self) -> dict[str, int | float]:
        """Return the numbers of points, and how far to trust them."""
        row: dict[str, int | float] = {"frame": self.number}
        row["radar points"] = int(np.asarray(self.points.valid).sum())
        row["enhanced points"] = int(np.asarray(self.cloud.valid).sum())
        if self.confidence is not None:
            row["confidence (%)"] = round(100 * self.confidence, 1)
        if self.unlikeness is not None:
            row["unlike training (%)"] = round(100 * self.unlikeness, 1)
        return row


class Pipeline:
    """Makes clouds of the frames of one radar, in the order of time; host."""

    def __init__(
        self,
        recording: Recording,
        model: Model,
        *,
        points: PointSpec | None = None,
        seed: int = 0,
        fuse: int = 1,
        history_s: float = 0.0,
        anyway: bool = False,
        **drawing: Unpack[Drawing],
    ):
        """Compile what the frames of a recording's radar need.

        `recording` describes the radar, its place and motion; it may hold no frame yet.
        `points` are by default the model's, and every frame draws with the key of
        `seed`. Of the frames before it, the images of `fuse - 1` are fused with each,
        or the points of the last `history_s` seconds are added to its own. `anyway`
        accepts a radar that does not measure what the model needs. Raises UsageError
        for a radar or options that do not suit the model.
        """
        if not anyway and (why := warnings.needs_more(model, recording)):
            raise UsageError(why)
        self.recording, self.model, self.fuse = recording, model, fuse
        radar = None if recording.of_points else recording.radar
        self._strange = warnings.strange_from(model, radar and radar.spec)
        self.watch = Stopwatch()
        self.history_s = history_s
        if fuse > 1:
            self._check_fusing(**drawing)
        if history_s:
            self._check_history()
        if model.spec.frame_grid.history > 1 and len(recording.frames):
            check_history(recording)
        self.reset()
        self._stages = Stages(
            jax.random.key(seed),
            radar,
            model,
            points=points,
            fuse=fuse,
            joined=history_s > 0,
            watch=self.watch,
            **drawing,
        )

    def reset(self) -> None:
        """Forget the frames so far."""
        fuse, history = self.fuse, self.model.spec.frame_grid.history
        self._fused = LastFrames(self.recording, fuse) if fuse > 1 else None
        self._images = LastImages(history) if history > 1 else None
        self._points = self._last_points() if self.history_s else None
        self._tally = warnings.Tally(self._strange)
        self._view = warnings.InView(self.model)

    def frame(
        self, number: int, measured: Measured, stamp_s: float | None = None
    ) -> Frame:
        """Return one frame, enhanced: the paper, from samples to a cloud (Fig. 3b).

        `measured` holds the samples, or the points of a radar that sends these.
        """
        observed = self.observe(number, measured, stamp_s)
        image = self.answer(number, observed, stamp_s)
        cloud = self.cloud(image, observed)
        return self.judge(number, stamp_s, observed, image, cloud)

    def observe(
        self, number: int, measured: Measured, stamp_s: float | None = None
    ) -> Observed:
        """Return the radar's side of a frame: samples, points and condition."""
        observed = self._stages.find(measured)
        if self._points is not None:
            time_s = math.nan if stamp_s is None else stamp_s
            add = functools.partial(self._points.add, number, time_s)
            observed = observed._replace(
                points=self.watch("history", add, observed.points)
            )
        observed = self._stages.see(observed)
        if self._images is not None:
            time_s = math.nan if stamp_s is None else stamp_s
            whole = self._images.add(observed.condition, time_s)
            observed = observed._replace(condition=whole)
        return observed

    def detections(self, observed: Observed) -> Detections:
        """Return the power map of a frame and its cells above the noise.

        Points that the radar sent come without.
        """
        if observed.samples is None:
            return None, None
        return self._stages.detections(observed)

    def answer(self, number: int, observed: Observed, stamp_s: float | None) -> Any:
        """Return the model's image of a frame, fused with the frames before it."""
        seen = self._stages.answer(observed)
        if self._fused is None:
            return seen
        time_s = math.nan if stamp_s is None else stamp_s
        return self._stages.fuse(*self._fused.add(number, time_s, seen), observed)

    def cloud(self, image: Any, observed: Observed) -> PointCloud:
        """Return the points of an image, and those around the radar's."""
        return self._stages.cloud(image, observed)

    def judge(
        self,
        number: int,
        stamp_s: float | None,
        observed: Observed,
        image: Any,
        cloud: PointCloud,
        *,
        detections: Detections = (None, None),
    ) -> Frame:
        """Return a frame with its confidence and its warnings.

        `detections` are what the method `detections` returns, for pictures and counts.
        """
        power, detected = detections
        strange = observed.unlikeness
        frame = Frame(
            number=number,
            stamp_s=stamp_s,
            samples=observed.samples,
            power=power,
            detected=detected,
            points=observed.points,
            image=image,
            cloud=cloud,
            confidence=None,
            unlikeness=None if strange is None else float(strange),
            warnings=(),
        )
        if image.confidence is not None and (kept := frame.pixels).any():
            sure = float(np.asarray(image.confidence)[kept].mean())
            frame = frame._replace(confidence=sure)
        alone = warnings.Tally(self._strange)
        for tally in (alone, self._tally):
            tally.add(frame)
        if self.recording.of_points:
            self._view.add(frame.points)
        return frame._replace(warnings=tuple(alone.warnings(self.recording.radar)))

    def before(self, frames: range) -> range:
        """Return the frames that must be answered before these, for their history.

        Of several images, the oldest may be that of the last frame before their span.
        """
        first = max(0, frames.start - self.fuse + 1)
        span_s = self.history_s if self._images is None else self._images.span_s
        times = frame_times(self.recording)
        if span_s and times is not None:
            first = int(np.searchsorted(times, times[frames.start] - span_s)) - 1
            first = max(0, first)
        return range(first, frames.start)

    @property
    def times(self) -> dict[str, float]:
        """Median seconds of each stage, and the time to compile."""
        times = {name: float(np.median(taken)) for name, taken in self.watch.items()}
        return times | {"compiling": sum(self.watch.get("compiling", ()))}

    @property
    def motion(self) -> dict[str, int]:
        """The number of steps between fused frames that each source of motion gave."""
        source = self._fused or self._points
        return {} if source is None else source.steps

    @property
    def warnings(self) -> Iterator[str]:
        """Warnings about the radar and the frames so far."""
        radar, of_points = self.recording.radar, self.recording.of_points
        yield from warnings.of_model(self.model, None if of_points else radar.spec)
        yield from self._tally.warnings(radar)
        yield from self._view.warnings()
        for earlier in (self._fused, self._points):
            if earlier is not None:
                yield from earlier.warnings()

    def _last_points(self) -> LastPoints:
        """Return the points so far: none."""
        recording, limit = self.recording, None
        if not recording.of_points:
            folds = 2 * self.model.spec.points.folds + 1
            limit = recording.radar.spec.max_velocity_mps * folds
        return LastPoints(recording, self.history_s, unambiguous_mps=limit)

    def _check_history(self) -> None:
        """Raise UsageError for points of several frames that make no condition."""
        if self.fuse > 1:
            raise UsageError(
                f"history_s = {self.history_s:g} and fuse = {self.fuse}: both add the "
                "frames before each, expected one of them"
            )
        if (kind := self.model.spec.frame_grid.kind) != "view":
            raise UsageError(
                f"history_s = {self.history_s:g}: a model of {kind} images sees no "
                "points: leave history_s out"
            )

    def _check_fusing(self, **drawing: Any) -> None:
        """Raise UsageError for frames that cannot be fused."""
        view_grid(self.model)
        if len(self.recording.frames) == 1:
            raise UsageError(
                f"fuse = {self.fuse}: {self.recording.path} has one frame, expected "
                "several: leave fuse out"
            )
        drawing.pop("least_confidence", None)
        if asked := given(drawing):
            raise UsageError(
                f"{', '.join(asked)}: a model of one pass draws no samples, so leave "
                "these options out"
            )


def without_interference(model: Model, remove: bool | None) -> Model:
    """Return the model with this option in its `points`; None leaves it as it is."""
    if remove is None:
        return model
    points = dataclasses.replace(model.spec.points, remove_interference=remove)
    spec = dataclasses.replace(model.spec, points=points)
    return dataclasses.replace(model, spec=spec)
