"""`jradar enhance`: frames of a recording through a trained model, every stage timed.

The stages of `jradar.enhance` are compiled before the first frame, so their times do
not include compiling. Every frame uses the same noise: its result does not depend on
which other frames are enhanced. Frames that `--fuse` needs before the first are read,
and are not written.
"""

import argparse
import collections
import contextlib
import dataclasses
import functools
import statistics
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jradar import recordings
from jradar.cli import doubts, fusing
from jradar.cli.limits import check_limits, within_limits
from jradar.cli.paths import is_streamed
from jradar.cli.reading import (
    frame_points,
    no_echoes,
    open_frames,
    summary,
)
from jradar.cli.writing import check_flat, write_frame
from jradar.errors import UsageError
from jradar.model import (
    Model,
    ModelSpec,
    compiler_options,
    dense_cloud,
    draw,
    load_model,
)
from jradar.progress import progress
from jradar.radar import RadarSpec, detect, excise_interference, power_map
from jradar.range_image import (
    RangeImage,
    condition_image,
    unlikeness,
    unproject,
)
from jradar.types import PointCloud

DETECTION_RATE = 1e-3  # false alarms per cell of the detections that are counted
AHEAD = 2  # frames that wait between two threads
# The stages of a frame, by the thread that runs them.
POINTS = ("radar processing", "condition")
ANSWER = ("sampling", "back projection")
REPORT = ("range doppler map", "detections")


class Stopwatch(dict[str, list[float]]):
    """The seconds of each call, by stage."""

    def __call__(self, stage: str, call: Callable, *arguments: Any) -> Any:
        """Return the call's result, once it is ready."""
        begin = time.perf_counter()
        result = jax.block_until_ready(call(*arguments))
        self.setdefault(stage, []).append(time.perf_counter() - begin)
        return result


class Enhanced(NamedTuple):
    """One frame on its way from the reader to the writer."""

    frame: int
    cube: Any
    power: Any
    cloud: PointCloud
    image: RangeImage
    dense: PointCloud
    row: dict[str, Any]


def enhance_frames(options: argparse.Namespace) -> dict[str, Any]:
    """Enhance the frames that the options name, and write the results.

    Three threads read ahead, find the radar points, and write, while this one runs the
    network. A recording takes as long as its slowest thread, if there are cores enough.
    """
    check_limits(options)
    check_flat(options)
    if is_streamed(options.output) and options.frame is None:
        options.frames = options.frames or slice(None)
    model = load_model(options.model)
    if options.remove_interference:
        model = _excising(model)
    recording, frames = open_frames(options)
    spec, watch = model.spec, Stopwatch()
    if (blind := doubts.blind(recording.radar)) and not options.anyway:
        raise UsageError(
            f"{blind}, which was trained on {spec.radar.name}: use `jradar points`, or "
            "add --anyway"
        )
    if options.fuse > 1:
        fusing.check_fusing(options, spec, recording)
    lead = range(max(0, frames.start - options.fuse + 1), frames.start)
    last = fusing.LastFrames(recording, options.fuse)
    key = jax.random.key(options.seed)
    # Excised once, for the points and for the map.
    excised = _excised if spec.points.remove_interference else None
    stages = watch("compiling", _compiled_stages, key, model, recording, options)
    pictured = _is_pictured(options)

    def read(frame):
        return frame, watch("reading", recordings.calibrated_cube, recording, frame)

    def process(read):
        frame, cube = read
        values = [watch("interference", excised, cube) if excised else cube]
        return frame, through(POINTS, values)

    def answer(processed):
        frame, values = processed
        if options.fuse > 1:
            through(("sampling",), values)
            poses = last.add(frame, values[-1])
            if frame in lead:
                return None
            values[-1] = watch("fusion", stages["fusion"], *last.filled(poses))
            return frame, through(("back projection",), values)
        return frame, through(ANSWER, values)

    def through(names, values):
        for name in names:
            values.append(watch(name, stages[name], key, model, *values))
        return values

    def write(answered):
        frame, values = answered
        result = _result(frame, through(REPORT, values), spec, options)
        files = watch("writing", put, recording, spec, result, options, pictured)
        return result.row, files

    rows, written = list[dict[str, Any]](), list[str]()
    begin = time.perf_counter()
    with (
        ThreadPoolExecutor(1) as reader,
        ThreadPoolExecutor(1) as processor,
        ThreadPoolExecutor(1) as writer,
        _output(options, writer) as put,
        progress("enhancing", len(frames), unit="frames") as show,
    ):
        wanted = (*lead, *frames)
        processed = _ahead(processor, process, _ahead(reader, read, wanted))
        answered = filter(None, map(answer, processed))
        for row, files in _ahead(writer, write, answered):
            rows.append(row)
            written = files
            if len(frames) > 1:
                show(len(rows))
    seconds = time.perf_counter() - begin
    notes = (
        *doubts.of_radar(spec, recording.radar),
        *no_echoes([row["frame"] for row in rows if not row["radar points"]]),
        *doubts.strangers(rows),
        *doubts.unsure(rows, calibrated=_calibrated(recording)),
        *last.notes(),
    )
    return {
        **summary(recording, notes),
        "model": {
            "name": str(options.model),
            "purpose": spec.purpose,
            "training steps": spec.steps_seen,
            "trained on": f"{spec.trained_on}, radar {spec.radar.name}",
        },
        **(last.report() if options.fuse > 1 else {}),
        **({"enhanced": rows} if options.frames else rows[0]),
        **_times(watch),
        "frames/s": len(rows) / seconds,
        "written": [options.output] if options.frames else written,
    }


def _is_pictured(options: argparse.Namespace) -> bool:
    """True if frames are drawn: by default a single one that has a folder."""
    if options.picture is None:
        return not (options.frames or options.flat)
    return options.picture


def _ahead(threads: ThreadPoolExecutor, call: Callable, items: Iterable) -> Iterator:
    """Yield `call(item)` in order; a thread works on the next items meanwhile."""
    waiting: collections.deque[Future] = collections.deque()
    for item in items:
        waiting.append(threads.submit(call, item))
        if len(waiting) > AHEAD:
            yield waiting.popleft().result()
    while waiting:
        yield waiting.popleft().result()


def _result(frame: int, values: list[Any], spec: ModelSpec, options) -> Enhanced:
    """What is written of a frame, from the results of all stages."""
    cube, cloud, seen, image, dense, power, detections = values
    silent = not np.asarray(cloud.valid).any()
    cloud, dense = (within_limits(c, options) for c in (cloud, dense))
    kept = np.asarray(dense.valid)
    row: dict[str, Any] = {
        "frame": frame,
        "detections": int(detections),
        "radar points": 0 if silent else int(np.asarray(cloud.valid).sum()),
        "enhanced points": int(kept.sum()),
    }
    if dense.confidence is not None and kept.any():
        mean = float(np.asarray(dense.confidence)[kept].mean())
        row["confidence (%)"] = round(100 * mean, 1)
    if spec.trust is not None:
        row["unlike training (%)"] = round(100 * float(unlikeness(seen, spec.trust)), 1)
    return Enhanced(frame, cube, power, cloud, image, dense, row)


def _calibrated(recording) -> bool:
    """Whether a description of the recording holds factors of its channels."""
    known = recording.channel_factors, recording.frequency_phase
    return any(part is not None for part in known)


def _excising(model: Model) -> Model:
    """Return the model with points that are free of crossing chirps."""
    points = dataclasses.replace(model.spec.points, remove_interference=True)
    return Model(model.params, dataclasses.replace(model.spec, points=points))


def _compiled_stages(key, model: Model, recording, options) -> dict[str, Callable]:
    """Compile the stages of `jradar.enhance` and the counts beside them.

    Each takes the key, the model, the cube and the results of the stages before it.
    Threads compile them, because XLA does not hold Python's lock.
    """
    spec, radar = model.spec, recording.radar
    points = dataclasses.replace(spec.points, remove_interference=False)
    counted = dataclasses.replace(points, false_alarm_rate=DETECTION_RATE)
    counted = counted.fitted(radar)

    def radar_processing(_key, _model, cube):
        return frame_points(cube, recording, points)

    def condition(_key, _model, _cube, cloud):
        return condition_image(cloud, spec.coarse, num_slices=spec.num_slices)

    def sampling(key, model, _cube, cloud, condition):
        if options.fuse > 1:
            return fusing.see(cloud, condition, model, recording)
        return draw(
            key,
            condition,
            model,
            draws=options.draws,
            steps=options.steps,
            least_confidence=options.min_confidence,
        )

    def back_projection(_key, _model, _cube, cloud, _condition, image):
        return dense_cloud(image, cloud, spec)

    def range_doppler_map(_key, _model, cube, *_results):
        return power_map(cube)

    def detections(_key, _model, _cube, _cloud, _condition, _image, _dense, power):
        return detect(power, radar, points=counted).sum()

    compiling: dict[str, Future] = {}
    kind = jnp.float32 if radar.real_samples else jnp.complex64
    values: list[Any] = [jax.ShapeDtypeStruct(radar.cube_shape, kind)]
    threads = ThreadPoolExecutor()
    if spec.points.remove_interference:
        threads.submit(_excised.lower(*values).compile)
    for stage in (
        radar_processing,
        condition,
        sampling,
        back_projection,
        range_doppler_map,
        detections,
    ):
        traced = jax.jit(stage, keep_unused=True).trace(key, model, *values)
        name = stage.__name__.replace("_", " ")
        compile_ = traced.lower().compile
        compiling[name] = threads.submit(compile_, compiler_options())
        values.append(traced.out_info)
        if stage is sampling and options.fuse > 1:
            poses = jax.ShapeDtypeStruct((options.fuse, 4, 4), jnp.float32)
            seen = (values.pop(),) * options.fuse
            fused = jax.jit(fusing.fusion(options, spec)).trace(seen, poses)
            compile_ = fused.lower().compile
            compiling["fusion"] = threads.submit(compile_, compiler_options())
            values.append(fused.out_info)
    if options.min_confidence is not None and values[3].confidence is None:
        raise UsageError(
            "--min-confidence: this model has no confidence with these options, leave "
            "it out, or draw several samples"
        )
    if _is_pictured(options):
        threads.submit(_prepare_picture, radar, spec)
    threads.shutdown(wait=False)
    return {name: future.result() for name, future in compiling.items()}


@jax.jit
def _excised(cube):
    """The samples without crossing chirps of other radars."""
    return excise_interference(cube)[0]


def _prepare_picture(radar: RadarSpec, spec: ModelSpec) -> None:
    """Import and compile what the first picture needs, while the stages compile."""
    from jradar import viz

    power = np.zeros((radar.num_chirps, radar.num_range_bins), np.float32)
    empty = unproject(jnp.zeros(spec.fine.shape), spec.fine)
    viz.capture_figure(power, radar, empty, spec.fine, dense=empty)


def _times(watch: Stopwatch) -> dict[str, Any]:
    """Return the median time of each stage, and the time to compile."""
    (compiling,) = watch.pop("compiling")
    return {
        "milliseconds per frame": {
            name: 1e3 * statistics.median(times) for name, times in watch.items()
        },
        "compiling (s)": compiling,
    }


@contextlib.contextmanager
def _output(
    options: argparse.Namespace, thread: ThreadPoolExecutor
) -> Iterator[Callable[..., list[str]]]:
    """Yield the function that writes a frame: into a folder, or to one file of all.

    The `thread` opens, writes and closes that file, as SQLite asks.
    """
    if not is_streamed(options.output):
        yield _write
        return
    from jradar.stream.outputs import open_writer

    writer = thread.submit(open_writer, options.output).result()
    try:
        yield functools.partial(_publish, writer)
    finally:
        thread.submit(writer.close).result()


def _publish(
    writer, recording, _spec, result: Enhanced, options, _pictured
) -> list[str]:
    """Write the clouds and the picture of one frame to a file of all frames."""
    from jradar.stream.views import lidar_cloud, range_azimuth, recorded_view

    clouds = {"radar": result.cloud, "enhanced": result.dense}
    if (lidar := recordings.nearest_scan(recording, result.frame)) is not None:
        clouds["lidar"] = lidar_cloud(lidar)
    picture = np.asarray(range_azimuth(jnp.asarray(result.cube), recording.radar))
    writer.write(recorded_view(recording, result.frame, clouds, picture))
    return [options.output]


def _write(
    recording, spec: ModelSpec, result: Enhanced, options, pictured: bool
) -> list[str]:
    """Write the clouds, the range image and a picture of one frame."""
    image = result.image.range_m
    kept = result.dense.valid.reshape(image.shape)
    return write_frame(
        options,
        result.frame,
        {"radar": result.cloud, "enhanced": result.dense},
        functools.partial(_picture, recording, spec, result) if pictured else None,
        arrays={"range_image": np.where(kept, image, 0)},
    )


def _picture(recording, spec: ModelSpec, result: Enhanced):
    """The range-Doppler map and both clouds, with the LiDAR's where there is one."""
    from jradar import viz  # matplotlib loads while the stages compile

    return viz.capture_figure(
        result.power,
        recording.radar,
        result.cloud,
        spec.fine,
        dense=result.dense,
        lidar=recordings.nearest_scan(recording, result.frame),
        title=f"{recording.name}, frame {result.frame}; model: {spec.purpose}",
    )
