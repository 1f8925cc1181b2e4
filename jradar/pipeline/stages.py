"""The stages of one frame, each compiled on its own so that it can be timed.

    cube -> cleaning -> points -> condition -> answer -> [fusion] -> cloud
    points that a radar sent   -> condition ..

`jradar.enhance` is the same in one function, `enhance_points` the second line. Every
frame uses the same noise, so its result does not depend on which other frames are
enhanced.
"""

import dataclasses
import functools
import time
from collections.abc import Callable, Generator, Iterator
from typing import Any, NamedTuple, Unpack

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Inexact, Int, Key

from jradar.errors import UsageError
from jradar.model import FrameGrid, Model, dense_cloud, draw
from jradar.options.drawing import Drawing, given
from jradar.pipeline import fusion, programs
from jradar.radar import (
    PointSpec,
    Radar,
    RadarSpec,
    calibrate,
    detect,
    excise_interference,
    points_and_count,
    power_map,
)
from jradar.range_image import RangeImage, unlikeness
from jradar.types import PointCloud

Measured = Inexact[Any, "tx rx chirp sample"] | PointCloud
DETECTION_RATE = 1e-3  # false alarms per cell of the detections that are counted


class Observed(NamedTuple):
    """What the radar measured in one frame; points that it sent have no samples."""

    samples: Inexact[Array, "tx rx chirp sample"] | None  # calibrated, cleaned
    points: PointCloud
    detected: Int[Array, ""] | None  # cells of usable ranges that the detector marked
    condition: Float[Array, "row column channel"] | None  # None without a model
    unlikeness: Float[Array, ""] | None  # share of training frames that are more usual


class Stopwatch(dict[str, list[float]]):
    """The seconds of each call, by stage."""

    def __call__(self, stage: str, call: Callable, *arguments: Any) -> Any:
        """Return the call's result, once it is ready."""
        begin = time.perf_counter()
        result = jax.block_until_ready(call(*arguments))
        self.setdefault(stage, []).append(time.perf_counter() - begin)
        return result


@dataclasses.dataclass(frozen=True)
class _Programs:
    """The function of each stage, and the options that shape it."""

    spec: PointSpec
    clean: bool
    count: int  # of frames that become one
    joined: bool  # whether points of other frames are added to a frame's
    drawing: tuple[tuple[str, Any], ...]  # as in `Drawing`

    def cleaned(self, _key, radar, _model, cube):
        samples = calibrate(cube, radar)
        return excise_interference(samples)[0] if self.clean else samples

    def found(self, _key, radar, _model, samples):
        radar = radar.once_calibrated()
        return points_and_count(samples, radar, points=self.spec)

    def conditioned(self, _key, radar, model, samples, points):
        grid: FrameGrid = model.spec.grid
        condition = grid.condition(samples, points, _spec(radar))
        if (trust := model.tables.trust) is None:
            return condition, None
        return condition, unlikeness(grid.features(condition), trust)

    def answered(self, key, radar, model, points, condition):
        if self.count > 1:
            return fusion.see(points, condition, model, _spec(radar))
        return draw(key, condition, model, **dict(self.drawing))

    def fused(self, _key, _radar, model, seen, poses):
        return fusion.fused(seen, poses, model, least_confidence=self.least)

    def cloud(self, _key, _radar, model, image, points):
        fused = self.count > 1
        least = {"least_confidence": self.least}
        return dense_cloud(image, points, model, fused=fused, **least)

    @property
    def least(self):
        return dict(self.drawing).get("least_confidence")

    def detected(self, _key, radar, _model, samples):
        power = power_map(samples, remove_static=self.spec.remove_static)
        rate = dataclasses.replace(self.spec, false_alarm_rate=DETECTION_RATE)
        return power, detect(power, radar.spec, points=rate)


class Stages:
    """The stages of one radar's frames, compiled before the first one.

    Radars and models that differ only in their numbers share the compiled programs.
    Without a radar, frames are points that it sent. Those are compiled when a frame is
    the first of its size, as `PointCloud.padded` gives it.
    """

    def __init__(
        self,
        key: Key[Array, ""],
        radar: Radar | None,
        model: Model | None,
        *,
        points: PointSpec | None = None,
        fuse: int = 1,
        joined: bool = False,
        watch: Stopwatch | None = None,
        **drawing: Unpack[Drawing],
    ):
        """`points` are by default the model's, without a model those of `PointSpec`.

        The other options are those of `draw`, and `fuse` frames are fused. If frames
        are `joined`, points are added between `find` and `see`. Raises ValueError for
        options that the model does not take.
        """
        if points is None:
            points = PointSpec() if model is None else model.spec.points
        # Samples are cleaned once, for the points and for the map.
        found = dataclasses.replace(points, remove_interference=False)
        self.spec = found if radar is None else found.fitted(radar.spec)
        self._key, self._radar, self._model = key, radar, model
        self._programs = _Programs(
            spec=self.spec,
            clean=points.remove_interference,
            count=fuse,
            joined=joined,
            drawing=tuple(given(drawing).items()),
        )
        self._watch = Stopwatch() if watch is None else watch
        self._compiled: dict[Any, dict[str, Callable]] = {}
        if radar is not None:
            self._ready(None)

    def observe(self, measured: Measured) -> Observed:
        """Return what the radar measured, and what the model is given of it."""
        return self.see(self.find(measured))

    def find(self, measured: Measured) -> Observed:
        """Return what the radar measured: samples as recorded, or points that it sent.

        Raises ValueError for more points than a radar sends.
        """
        samples = detected = None
        if isinstance(measured, PointCloud):
            points = jax.device_put(measured.padded())
        else:
            samples = self._run("cleaning", None, jnp.asarray(measured))
            points, detected = self._run("points", None, samples)
        return Observed(samples, points, detected, None, None)

    def see(self, observed: Observed) -> Observed:
        """Return what was observed, with the condition of its points."""
        if self._model is None:
            return observed
        points = jax.device_put(observed.points)
        samples = None if self._programs.joined else observed.samples
        condition, strange = self._run("condition", points, samples, points)
        seen = {"condition": condition, "unlikeness": strange}
        return observed._replace(points=points, **seen)

    def detections(
        self, observed: Observed
    ) -> tuple[Float[Array, "doppler range"], Bool[Array, "doppler range"]]:
        """Return the power map and its cells above the noise.

        In noise alone, 1 cell in 1,000 is above it.
        """
        return self._run("detections", None, observed.samples)

    def answer(self, observed: Observed) -> Any:
        """Return the model's image of a frame, or what `fuse` takes of it."""
        points = observed.points
        return self._run("answer", points, points, observed.condition)

    def fuse(
        self,
        seen: tuple[fusion.Seen, ...],
        poses: Float[Any, "frame 4 4"],
        observed: Observed,
    ) -> RangeImage:
        """Return the image of the newest frame, as all frames together see it."""
        return self._run("fusion", observed.points, seen, poses)

    def cloud(self, image: Any, observed: Observed) -> PointCloud:
        """Return the points of an image, and those around the radar's."""
        return self._run("cloud", observed.points, image, observed.points)

    def _run(self, stage: str, points: PointCloud | None, *values: Any) -> Any:
        run = self._ready(points)[stage]
        given = self._key, self._radar, self._model
        return self._watch(stage, run, *given, *values)

    def _ready(self, points: PointCloud | None) -> dict[str, Callable]:
        """Return the programs for points of this size; a radar's samples need one."""
        sent = None
        if points is not None and (self._radar is None or self._programs.joined):
            sent = jax.tree.map(programs.shaped, points)
        name = repr(sent)
        if name not in self._compiled:
            self._compiled[name] = self._watch("compiling", self._compile, sent)
        return self._compiled[name]

    def _compile(self, sent: PointCloud | None) -> dict[str, Callable]:
        """Return the programs of the stages."""
        given = self._key, self._radar, self._model, sent
        model = None if self._model is None else self._model.spec
        options = self._programs, _spec(self._radar), model
        trace = functools.partial(self._trace, sent)
        return programs.ready(given, *options, trace=trace)

    def _trace(self, sent: PointCloud | None) -> Iterator[tuple[str, programs.Program]]:
        """Yield the stages' programs, one after the other.

        Raises UsageError for a least confidence if the model has no confidence.
        """
        options, given = self._programs, (self._key, self._radar, self._model)
        samples, points = None, sent
        if self._radar is not None and sent is None:
            samples, points = yield from self._trace_samples(self._radar.spec)
            if options.joined:
                return
        if self._model is None:
            return
        measured = *given, samples, points
        program, (condition, _) = programs.traced(options.conditioned, *measured)
        yield "condition", program
        program, image = programs.traced(options.answered, *given, points, condition)
        yield "answer", program
        if options.count > 1:
            poses = jax.ShapeDtypeStruct((options.count, 4, 4), jnp.float32)
            seen = (image,) * options.count
            program, image = programs.traced(options.fused, *given, seen, poses)
            yield "fusion", program
        least = options.least
        if least is not None and image.confidence is None:
            raise UsageError(
                f"least_confidence = {least:g}: this model has no confidence with "
                "these options. Leave it out, or draw several samples"
            )
        program, _ = programs.traced(options.cloud, *given, image, points)
        yield "cloud", program

    def _trace_samples(
        self, spec: RadarSpec
    ) -> Generator[tuple[str, programs.Program], None, tuple[Any, Any]]:
        """Yield the programs from samples to points; return the kinds of both."""
        options, given = self._programs, (self._key, self._radar, self._model)
        kind = jnp.float32 if spec.real_samples else jnp.complex64
        cube = jax.ShapeDtypeStruct(spec.cube_shape, kind)
        program, samples = programs.traced(options.cleaned, *given, cube)
        yield "cleaning", program
        program, (points, _) = programs.traced(options.found, *given, samples)
        yield "points", program
        program, _ = programs.traced(options.detected, *given, samples)
        yield "detections", program
        return samples, points


def _spec(radar: Radar | None) -> RadarSpec | None:
    return None if radar is None else radar.spec
