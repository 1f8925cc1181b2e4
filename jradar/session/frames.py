"""Frames of a recording to dense clouds, one after another, as `jradar enhance` does.

    for frame in enhance_recording(recording, model, fuse=3):
        frame.cloud, frame.warnings, frame.times

Four threads work on consecutive frames: one reads, one finds the radar points, one runs
the network, and the caller does with a frame what it likes. A recording takes as long
as its slowest thread, if there are cores enough.
"""

import collections
import dataclasses
import math
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Inexact, Key

from jradar.errors import UsageError
from jradar.planar import PlanarImage, PlanarModel, azimuth_row
from jradar.range_image import RangeImage
from jradar.recordings import Recording, with_sample_doubts
from jradar.session import warnings
from jradar.session.fusion import LastFrames, check_fusing
from jradar.session.history import frame_times, last_images
from jradar.session.models import AnyModel
from jradar.session.stages import Heard, Stages, Stopwatch
from jradar.types import PointCloud

AHEAD = 2  # frames that wait between two threads


class Frame(NamedTuple):
    """One frame of a recording, enhanced."""

    number: int
    stamp_s: float | None  # None if the recording has no times
    samples: Inexact[Array, "tx rx chirp sample"]  # calibrated, without crossing chirps
    power: Float[Array, "doppler range"]
    detected: Bool[Array, "doppler range"]  # above the noise; 1 false alarm in 1,000
    points: PointCloud  # of the radar
    image: RangeImage | PlanarImage
    cloud: PointCloud
    confidence: float | None  # mean over the image's points; None if it has none
    unlikeness: float | None  # share of training frames that are more usual
    warnings: tuple[str, ...]

    @property
    def empty(self) -> bool:
        """Whether the detector found nothing."""
        return not np.asarray(self.points.valid).any()

    @property
    def pixels(self) -> Bool[np.ndarray, "row column"]:
        """Which pixels of the image are points of the cloud."""
        return _pixels(self.image, self.cloud)

    def describe(self) -> dict[str, int | float]:
        """Return the numbers of points, and how far to trust them."""
        row: dict[str, int | float] = {
            "frame": self.number,
            "detections": int(np.asarray(self.detected).sum()),
            "radar points": int(np.asarray(self.points.valid).sum()),
            "enhanced points": int(np.asarray(self.cloud.valid).sum()),
        }
        if self.confidence is not None:
            row["confidence (%)"] = round(100 * self.confidence, 1)
        if self.unlikeness is not None:
            row["unlike training (%)"] = round(100 * self.unlikeness, 1)
        return row


class Enhancement(Iterator[Frame]):
    """The frames of a recording as they come, and what is known of all so far."""

    def __init__(
        self,
        recording: Recording,
        model: AnyModel,
        frames: range,
        *,
        key: Key[Array, ""],
        fuse: int = 1,
        **drawing: Any,
    ):
        """Compile; `enhance_recording` describes the options."""
        self.recording, self.model, self.frames = recording, model, frames
        self.watch = Stopwatch()
        self._given: list[Frame] = []
        first = max(0, frames.start - fuse + 1)
        if (images := last_images(model)) is not None:
            self._times = frame_times(recording)
            begin_s = self._times[frames.start] - images.span_s
            first = int(np.searchsorted(self._times, begin_s))
        self._images = images
        self._iterator = self._run(range(first, frames.start))
        self._last = LastFrames(recording, fuse) if fuse > 1 else None
        self._stages = Stages(
            key, recording.radar, model, fuse=fuse, watch=self.watch, **drawing
        )

    def __next__(self) -> Frame:
        """Return the next frame."""
        frame = next(self._iterator)
        light = dict.fromkeys(("samples", "power", "detected", "image", "cloud"))
        self._given.append(frame._replace(**light))  # keeps what warnings need
        return frame

    @property
    def times(self) -> dict[str, float]:
        """Median seconds of each stage, and the time to compile."""
        return {name: float(np.median(taken)) for name, taken in self.watch.items()}

    @property
    def motion(self) -> dict[str, int]:
        """How many steps between fused frames each source of motion gave."""
        return {} if self._last is None else self._last.steps

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the radar, and about the frames so far."""
        spec = self.recording.radar.spec
        return (
            *warnings.of_model(self.model, spec),
            *warnings.of_frames(self._given, self.recording.radar),
            *([] if self._last is None else self._last.warnings()),
        )

    def _run(self, lead: range) -> Iterator[Frame]:
        """Yield the frames after those of `lead`, which are needed before them."""
        with (
            ThreadPoolExecutor(1) as reader,
            ThreadPoolExecutor(1) as processor,
            ThreadPoolExecutor(1) as network,
        ):
            read = ahead(reader, self._read, (*lead, *self.frames))
            heard = ahead(processor, self._hear, read)
            for number, *result in ahead(network, self._see, heard):
                if number not in lead:
                    yield self._frame(number, *result)

    def _read(self, number: int):
        return number, self.watch("reading", self.recording.cube, number)

    def _hear(self, read):
        number, cube = read
        heard = self._stages.hear(cube)
        return number, heard, self._stages.detections(heard)

    def _see(self, heard):
        number, radar, detected = heard
        if self._images is not None:
            whole = self._images.add(radar.condition, float(self._times[number]))
            radar = radar._replace(condition=whole)
        seen = self._stages.see(radar)
        if self._last is not None:
            seen = self._stages.fuse(*self._last.add(number, seen))
        return number, radar, detected, seen, self._stages.cloud(seen, radar)

    def _frame(self, number: int, heard: Heard, detected, image, cloud) -> Frame:
        power, cells = detected
        kept, confidence = _pixels(image, cloud), None
        if image.confidence is not None and kept.any():
            confidence = float(np.asarray(image.confidence)[kept].mean())
        strange = None if heard.unlikeness is None else float(heard.unlikeness)
        frame = Frame(
            number=number,
            stamp_s=stamp_s(self.recording, number),
            samples=heard.samples,
            power=power,
            detected=cells,
            points=heard.points,
            image=image,
            cloud=cloud,
            confidence=confidence,
            unlikeness=strange,
            warnings=(),
        )
        found = warnings.of_frames([frame], self.recording.radar)
        return frame._replace(warnings=tuple(found))


def _pixels(image: RangeImage | PlanarImage, cloud: PointCloud) -> np.ndarray:
    """Which pixels are points: a cloud begins with those of its image."""
    shape = np.shape(image[0])
    return np.asarray(cloud.valid)[: math.prod(shape)].reshape(shape)


def enhance_recording(
    recording: Recording,
    model: AnyModel,
    *,
    frames: slice | range = slice(None),
    seed: int = 0,
    fuse: int = 1,
    draws: int | None = None,
    steps: int | None = None,
    least_confidence: float | None = None,
    remove_interference: bool | None = None,
    anyway: bool = False,
) -> Enhancement:
    """Return an iterator over the enhanced `frames` of a recording; host.

    With `fuse`, the last frames become one, held together by the recorded poses or the
    radar's own velocity. `draws`, `steps` and `least_confidence` are those of `draw`,
    `remove_interference` that of `PointSpec`, by default the model's. Every frame draws
    with the key of `seed`. `anyway` enhances a radar that does not measure both angles;
    a planar model needs azimuths alone. Raises UsageError for frames that the recording
    lacks, for a radar that does not measure these angles, and for options that the
    model does not take.
    """
    chosen, spec = chosen_frames(recording, frames), recording.radar.spec
    if isinstance(model, PlanarModel):
        azimuth_row(spec)  # raises
    elif (without := warnings.blind(spec)) and not anyway:
        trained = model.card.radars[0].name if model.card.radars else "other radars"
        planar = f", {warnings.IN_THE_PLANE}" if spec.has_azimuth else ""
        raise UsageError(
            f"{without}, which was trained on {trained}: use `jradar points`{planar}, "
            "or add --anyway"
        )
    if fuse > 1:
        check_fusing(model, recording, frames=fuse)
        if draws or steps:
            raise UsageError(
                f"{draws=}, {steps=}: a model of one pass draws no samples, leave them "
                "out"
            )
    if remove_interference is not None:
        points = dataclasses.replace(
            model.spec.points, remove_interference=remove_interference
        )
        changed: Any = dataclasses.replace(model.spec, points=points)
        model = dataclasses.replace(model, spec=changed)
    return Enhancement(
        with_sample_doubts(recording, chosen[0]),
        model,
        chosen,
        key=jax.random.key(seed),
        fuse=fuse,
        draws=draws,
        steps=steps,
        least_confidence=least_confidence,
    )


def chosen_frames(recording: Recording, frames: slice | range) -> range:
    """Return the numbers of `frames`; UsageError for what the recording lacks."""
    count = len(recording.cubes)
    chosen = range(*frames.indices(count)) if isinstance(frames, slice) else frames
    if not chosen or chosen.start < 0 or chosen.stop > count:
        raise UsageError(
            f"frames = {frames}: {recording.path} has frames 0 to {count - 1}"
        )
    return chosen


def stamp_s(recording: Recording, frame: int) -> float | None:
    """Return the time of a frame, None if the recording has no times."""
    stamps = recording.cubes.stamps
    return None if stamps is None else float(stamps[frame])


def ahead(threads: ThreadPoolExecutor, call: Callable, items: Iterable) -> Iterator:
    """Yield `call(item)` in order; a thread works on the next items meanwhile."""
    waiting: collections.deque[Future] = collections.deque()
    try:
        for item in items:
            waiting.append(threads.submit(call, item))
            if len(waiting) > AHEAD:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        for future in waiting:
            future.cancel()
