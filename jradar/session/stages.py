"""The way of one frame, stage by stage, each compiled on its own so that it is timed.

    samples -> cleaning -> radar processing -> condition -> sampling
            -> [fusion] -> back projection

`jradar.enhance` is the same in one function. Every frame uses the same noise: its
result does not depend on which other frames are enhanced.
"""

import dataclasses
import functools
import time
import weakref
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Inexact, Int, Key

from jradar.errors import UsageError
from jradar.model import Model, compiler_options, dense_cloud, draw
from jradar.radar import (
    PointSpec,
    Radar,
    calibrate,
    detect,
    excise_interference,
    points_and_count,
    power_map,
)
from jradar.range_image import RangeImage, condition_image, unlikeness
from jradar.session import fusion
from jradar.types import PointCloud

# Compiled programs, or those to come, by what was traced, as long as JAX keeps that.
COMPILED: weakref.WeakKeyDictionary[Any, Future] = weakref.WeakKeyDictionary()
DETECTION_RATE = 1e-3  # false alarms per cell of the detections that are counted


class Heard(NamedTuple):
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

    points: PointSpec
    clean: bool
    count: int  # of frames that become one
    draws: int | None
    steps: int | None
    least_confidence: float | None

    def cleaned(self, _key, radar, _model, cube):
        samples = calibrate(cube, radar)
        return excise_interference(samples)[0] if self.clean else samples

    def found(self, _key, radar, _model, samples):
        radar = radar.once_calibrated()
        return points_and_count(samples, radar, points=self.points)

    def conditioned(self, _key, _radar, model, points):
        spec = model.spec
        image = condition_image(points, spec.coarse, num_slices=spec.num_slices)
        strange = None if model.trust is None else unlikeness(image, model.trust)
        return image, strange

    def sampled(self, key, radar, model, points, condition):
        if self.count > 1:
            return fusion.see(points, condition, model, radar.spec)
        return draw(
            key,
            condition,
            model,
            draws=self.draws,
            steps=self.steps,
            least_confidence=self.least_confidence,
        )

    def fused(self, _key, _radar, model, seen, poses):
        least = self.least_confidence
        return fusion.fused(seen, poses, model, least_confidence=least)

    def projected(self, _key, _radar, model, image, points):
        return dense_cloud(image, points, model.spec)

    def detected(self, _key, radar, _model, samples):
        power = power_map(samples, remove_static=self.points.remove_static)
        rate = dataclasses.replace(self.points, false_alarm_rate=DETECTION_RATE)
        return power, detect(power, radar.spec, points=rate)


@functools.lru_cache(maxsize=64)
def _jitted(function: Callable, programs: _Programs) -> Any:
    """Return the function of a stage, which is the same object for the same options."""
    return jax.jit(functools.partial(function, programs), keep_unused=True)


class Stages:
    """The stages of one radar's frames, compiled before the first one.

    Stages of the same radar and model, with other numbers, compile nothing again.
    """

    def __init__(
        self,
        key: Key[Array, ""],
        radar: Radar,
        model: Model | None,
        *,
        points: PointSpec | None = None,
        fuse: int = 1,
        draws: int | None = None,
        steps: int | None = None,
        least_confidence: float | None = None,
        watch: Stopwatch | None = None,
    ):
        """`points` are by default the model's, without a model those of `PointSpec`.

        The other options are those of `draw`; `fuse` frames become one. Raises
        ValueError for options that the model does not take.
        """
        if points is None:
            points = PointSpec() if model is None else model.spec.points
        # Samples are cleaned once, for the points and for the map.
        found = dataclasses.replace(points, remove_interference=False)
        self.points = found.fitted(radar.spec)
        self._key, self._radar, self._model = key, radar, model
        self._programs = _Programs(
            points=self.points,
            clean=points.remove_interference,
            count=fuse,
            draws=draws,
            steps=steps,
            least_confidence=least_confidence,
        )
        self._watch = Stopwatch() if watch is None else watch
        self._compiled = self._watch("compiling", self._compile)

    def hear(self, cube: Inexact[Any, "tx rx chirp sample"]) -> Heard:
        """Return the radar's side of a frame; `cube` holds the samples as recorded."""
        samples = self._run("cleaning", jnp.asarray(cube))
        points, detected = self._run("radar processing", samples)
        condition = strange = None
        if self._model is not None:
            condition, strange = self._run("condition", points)
        return Heard(samples, points, detected, condition, strange)

    def detections(
        self, heard: Heard
    ) -> tuple[Float[Array, "doppler range"], Bool[Array, "doppler range"]]:
        """Return the power map and its cells above the noise.

        Noise alone gives 1 in 1,000.
        """
        return self._run("detections", heard.samples)

    def see(self, heard: Heard) -> Any:
        """Return the model's image of a frame, or what `fuse` takes of it."""
        return self._run("sampling", heard.points, heard.condition)

    def fuse(
        self, seen: tuple[fusion.Seen, ...], poses: Float[Any, "frame 4 4"]
    ) -> RangeImage:
        """Return the image of the newest frame, as all frames together see it."""
        return self._run("fusion", seen, poses)

    def cloud(self, image: RangeImage, heard: Heard) -> PointCloud:
        """Return the points of an image, with the velocities of the radar's."""
        return self._run("back projection", image, heard.points)

    def _run(self, stage: str, *values: Any) -> Any:
        return self._watch(
            stage, self._compiled[stage], self._key, self._radar, self._model, *values
        )

    def _compile(self) -> dict[str, Callable]:
        """Compile the stages in threads, because XLA does not hold Python's lock."""
        spec, programs = self._radar.spec, self._programs
        kind = jnp.float32 if spec.real_samples else jnp.complex64
        compiling: dict[str, Future] = {}

        def add(stage: str, function: Callable, *values: Any) -> Any:
            traced = _jitted(function, programs).trace(
                self._key, self._radar, self._model, *values
            )
            if traced.jaxpr not in COMPILED:
                COMPILED[traced.jaxpr] = threads.submit(
                    traced.lower().compile, compiler_options()
                )
            compiling[stage] = COMPILED[traced.jaxpr]
            return traced.out_info

        threads = ThreadPoolExecutor()
        cube = jax.ShapeDtypeStruct(spec.cube_shape, kind)
        samples = add("cleaning", _Programs.cleaned, cube)
        points, _ = add("radar processing", _Programs.found, samples)
        add("detections", _Programs.detected, samples)
        if self._model is not None:
            condition, _ = add("condition", _Programs.conditioned, points)
            image = add("sampling", _Programs.sampled, points, condition)
            if programs.count > 1:
                poses = jax.ShapeDtypeStruct((programs.count, 4, 4), jnp.float32)
                seen = (image,) * programs.count
                image = add("fusion", _Programs.fused, seen, poses)
            least = programs.least_confidence
            if least is not None and image.confidence is None:
                raise UsageError(
                    f"least_confidence = {least:g}: this model has no confidence with "
                    "these options, leave it out, or draw several samples"
                )
            add("back projection", _Programs.projected, image, points)
        threads.shutdown(wait=False)
        return {name: future.result() for name, future in compiling.items()}
