"""The stages of one frame, each compiled on its own so that it can be timed.

    cube -> cleaning -> points -> condition -> answer -> [fusion] -> cloud

`jradar.enhance` is the same in one function. Every frame uses the same noise, so its
result does not depend on which other frames are enhanced.
"""

import dataclasses
import time
from collections.abc import Callable, Iterator
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
    calibrate,
    detect,
    excise_interference,
    points_and_count,
    power_map,
)
from jradar.range_image import RangeImage, unlikeness
from jradar.types import PointCloud

DETECTION_RATE = 1e-3  # false alarms per cell of the detections that are counted


class Observed(NamedTuple):
    """What the radar measured in one frame."""

    samples: Inexact[Array, "tx rx chirp sample"]  # calibrated, without crossing chirps
    points: PointCloud
    detected: Int[Array, ""]  # cells of usable ranges that the detector marked
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
    drawing: tuple[tuple[str, Any], ...]  # as in `Drawing`

    def cleaned(self, _key, radar, _model, cube):
        samples = calibrate(cube, radar)
        return excise_interference(samples)[0] if self.clean else samples

    def found(self, _key, radar, _model, samples):
        radar = radar.once_calibrated()
        return points_and_count(samples, radar, points=self.spec)

    def conditioned(self, _key, radar, model, samples, points):
        grid: FrameGrid = model.spec.grid
        condition = grid.condition(samples, points, radar.spec)
        if (trust := model.tables.trust) is None:
            return condition, None
        return condition, unlikeness(grid.features(condition), trust)

    def answered(self, key, radar, model, points, condition):
        if self.count > 1:
            return fusion.see(points, condition, model, radar.spec)
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
    """

    def __init__(
        self,
        key: Key[Array, ""],
        radar: Radar,
        model: Model | None,
        *,
        points: PointSpec | None = None,
        fuse: int = 1,
        watch: Stopwatch | None = None,
        **drawing: Unpack[Drawing],
    ):
        """`points` are by default the model's, without a model those of `PointSpec`.

        The other options are those of `draw`, and `fuse` frames are fused. Raises
        ValueError for options that the model does not take.
        """
        if points is None:
            points = PointSpec() if model is None else model.spec.points
        # Samples are cleaned once, for the points and for the map.
        found = dataclasses.replace(points, remove_interference=False)
        self.spec = found.fitted(radar.spec)
        self._key, self._radar, self._model = key, radar, model
        self._programs = _Programs(
            spec=self.spec,
            clean=points.remove_interference,
            count=fuse,
            drawing=tuple(given(drawing).items()),
        )
        self._watch = Stopwatch() if watch is None else watch
        self._compiled = self._watch("compiling", self._compile)

    def observe(self, cube: Inexact[Any, "tx rx chirp sample"]) -> Observed:
        """Return what the radar measured; `cube` holds the samples as recorded."""
        samples = self._run("cleaning", jnp.asarray(cube))
        points, detected = self._run("points", samples)
        condition = strange = None
        if self._model is not None:
            condition, strange = self._run("condition", samples, points)
        return Observed(samples, points, detected, condition, strange)

    def detections(
        self, observed: Observed
    ) -> tuple[Float[Array, "doppler range"], Bool[Array, "doppler range"]]:
        """Return the power map and its cells above the noise.

        In noise alone, 1 cell in 1,000 is above it.
        """
        return self._run("detections", observed.samples)

    def answer(self, observed: Observed) -> Any:
        """Return the model's image of a frame, or what `fuse` takes of it."""
        return self._run("answer", observed.points, observed.condition)

    def fuse(
        self, seen: tuple[fusion.Seen, ...], poses: Float[Any, "frame 4 4"]
    ) -> RangeImage:
        """Return the image of the newest frame, as all frames together see it."""
        return self._run("fusion", seen, poses)

    def cloud(self, image: Any, observed: Observed) -> PointCloud:
        """Return the points of an image, and those around the radar's."""
        return self._run("cloud", image, observed.points)

    def _run(self, stage: str, *values: Any) -> Any:
        return self._watch(
            stage, self._compiled[stage], self._key, self._radar, self._model, *values
        )

    def _compile(self) -> dict[str, Callable]:
        """Return the programs of the stages."""
        given = self._key, self._radar, self._model
        model = None if self._model is None else self._model.spec
        options = self._programs, self._radar.spec, model
        return programs.ready(given, *options, trace=self._trace)

    def _trace(self) -> Iterator[tuple[str, programs.Program]]:
        """Yield the stages' programs, one after the other.

        Raises UsageError for a least confidence if the model has no confidence.
        """
        options, spec = self._programs, self._radar.spec
        given = self._key, self._radar, self._model
        kind = jnp.float32 if spec.real_samples else jnp.complex64
        cube = jax.ShapeDtypeStruct(spec.cube_shape, kind)
        program, samples = programs.traced(options.cleaned, *given, cube)
        yield "cleaning", program
        program, (points, _) = programs.traced(options.found, *given, samples)
        yield "points", program
        program, _ = programs.traced(options.detected, *given, samples)
        yield "detections", program
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
