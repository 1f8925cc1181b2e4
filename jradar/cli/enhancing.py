"""`jradar enhance`: frames of a recording through a trained model, every stage timed.

The stages of `jradar.enhance` are compiled before the first frame, so their times do
not include compiling. Every frame uses the same noise: its result does not depend on
which other frames are enhanced.
"""

import argparse
import contextlib
import dataclasses
import functools
import statistics
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jradar import recordings
from jradar.cli.limits import check_limits, within_limits
from jradar.cli.paths import is_streamed
from jradar.cli.reading import frame_points, no_echoes, open_frames, summary
from jradar.errors import UsageError
from jradar.model import Model, ModelSpec, draw, load_model
from jradar.progress import progress
from jradar.radar import RadarSpec, detect, power_map
from jradar.range_image import STRANGE, condition_image, unlikeness, unproject

DETECTION_RATE = 1e-3  # false alarms per cell of the detections that are counted
TOLERANCE = 0.05  # up to which two radars count as alike
FLAT = (
    "this radar has one row of antennas and measures no elevation: heights in the "
    "result are invented by the model"
)


class Stopwatch(dict[str, list[float]]):
    """The seconds of each call, by stage."""

    def __call__(self, stage: str, call: Callable, *arguments: Any) -> Any:
        """Return the call's result, once it is ready."""
        begin = time.perf_counter()
        result = jax.block_until_ready(call(*arguments))
        self.setdefault(stage, []).append(time.perf_counter() - begin)
        return result


def enhance_frames(options: argparse.Namespace) -> dict[str, Any]:
    """Enhance the frames that the options name, and write the results."""
    check_limits(options)
    if is_streamed(options.output) and options.frame is None:
        options.frames = options.frames or slice(None)
    model = load_model(options.model)
    if options.remove_interference:
        model = _excising(model)
    recording, frames = open_frames(options)
    spec, watch = model.spec, Stopwatch()
    if not (recording.radar.has_elevation or options.anyway):
        raise UsageError(
            f"{FLAT}, which was trained on {spec.radar.name}: use `jradar points`, or "
            "add --anyway"
        )
    key = jax.random.key(options.seed)
    stages = watch("compiling", _compiled_stages, key, model, recording, options)
    rows, written, silent, strange = [], [], [], []
    with (
        _output(options) as write,
        progress("enhancing", len(frames), unit="frames") as show,
    ):
        for done, frame in enumerate(frames, 1):
            values = [watch("read", recordings.calibrated_cube, recording, frame)]
            for name, stage in stages.items():
                values.append(watch(name, stage, key, model, values[-1]))
            cube, cloud, seen, image, dense = values
            silent += [] if cloud.valid.any() else [frame]
            cloud, dense = (within_limits(c, options) for c in (cloud, dense))
            power = _power(cube, spec)
            drawn = power, cloud, image, dense
            written = watch("writing", write, recording, frame, spec, drawn, options)
            row: dict[str, Any] = {
                "frame": frame,
                "detections": _detections(power, recording.radar, spec),
                "radar points": int(cloud.valid.sum()),
                "enhanced points": int(dense.valid.sum()),
            }
            if spec.trust is not None:
                unlike = float(unlikeness(seen, spec.trust))
                row["unlike training (%)"] = round(100 * unlike, 1)
                strange += [frame] if unlike > STRANGE else []
            rows.append(row)
            if len(frames) > 1:
                show(done)
    notes = (
        *_doubts(spec, recording.radar),
        *no_echoes(silent),
        *_strangers(strange, len(frames)),
    )
    return {
        **summary(recording, notes),
        "model": {
            "name": str(options.model),
            "purpose": spec.purpose,
            "training steps": spec.steps_seen,
            "trained on": f"{spec.trained_on}, radar {spec.radar.name}",
        },
        **({"enhanced": rows} if options.frames else rows[0]),
        **_times(watch),
        "written": [options.output] if options.frames else written,
    }


def _excising(model: Model) -> Model:
    """Return the model with points that are free of crossing chirps."""
    points = dataclasses.replace(model.spec.points, remove_interference=True)
    return Model(model.params, dataclasses.replace(model.spec, points=points))


def _compiled_stages(key, model: Model, recording, options) -> dict[str, Callable]:
    """Compile the stages of `jradar.enhance`; each takes the result of the last.

    Threads compile them, because XLA does not hold Python's lock.
    """
    spec = model.spec

    def radar_processing(_key, _model, cube):
        return frame_points(cube, recording, spec.points)

    def condition(_key, _model, cloud):
        return condition_image(cloud, spec.coarse, num_slices=spec.num_slices)

    def sampling(key, model, condition):
        return draw(key, condition, model, draws=options.draws, steps=options.steps)

    def back_projection(_key, _model, image):
        return unproject(image, spec.fine)

    radar, compiling = recording.radar, {}
    kind = jnp.float32 if radar.real_samples else jnp.complex64
    value: Any = jax.ShapeDtypeStruct(radar.cube_shape, kind)
    threads = ThreadPoolExecutor()
    for stage in (radar_processing, condition, sampling, back_projection):
        traced = jax.jit(stage).trace(key, model, value)
        name = stage.__name__.replace("_", " ")
        compiling[name] = threads.submit(traced.lower().compile)
        value = traced.out_info
    threads.submit(_prepare_picture, radar, spec)
    threads.shutdown(wait=False)
    return {name: future.result() for name, future in compiling.items()}


def _prepare_picture(radar: RadarSpec, spec: ModelSpec) -> None:
    """Import and compile what the first picture needs, while the stages compile."""
    from jradar import viz

    kind = np.float32 if radar.real_samples else np.complex64
    power = _power(np.zeros(radar.cube_shape, kind), spec)
    _detections(power, radar, spec)
    empty = unproject(jnp.zeros(spec.fine.shape), spec.fine)
    viz.capture_figure(power, radar, empty, spec.fine, dense=empty)


def _power(cube, spec: ModelSpec):
    """The range-Doppler map, for the picture and for counting."""
    return power_map(cube, remove_interference=spec.points.remove_interference)


def _detections(power, radar: RadarSpec, spec: ModelSpec) -> int:
    """The number of cells over the threshold; the model is shown weaker ones too."""
    points = dataclasses.replace(spec.points, false_alarm_rate=DETECTION_RATE)
    return int(detect(power, radar, points=points.fitted(radar)).sum())


def _times(watch: Stopwatch) -> dict[str, Any]:
    """Return the median time of each stage, the frame rate and the compile time."""
    (compiling,) = watch.pop("compiling")
    stages = {name: 1e3 * statistics.median(times) for name, times in watch.items()}
    drawing = sum(stages.values()) - stages["writing"]
    return {
        "milliseconds per frame": stages,
        "frames/s without writing": 1e3 / drawing,
        "compiling (s)": compiling,
    }


def _doubts(spec: ModelSpec, radar: RadarSpec):
    """Yield why the model may not suit this radar."""
    if not radar.has_elevation:
        yield FLAT
    here, trained = _waveform(radar), _waveform(spec.radar)
    differ = [
        f"{name.format(value)} here, {trained[name]:.3g} in training"
        for name, value in here.items()
        if abs(value - trained[name]) > TOLERANCE * abs(trained[name])
    ]
    if differ:
        yield (
            f"the model was trained on another radar ({spec.radar.name}), expect worse "
            f"clouds: {'; '.join(differ)}"
        )


def _strangers(frames: list[int], total: int):
    """Yield a warning for frames unlike those of training."""
    if frames:
        which = f"frame {frames[0]}" if len(frames) == 1 else f"{len(frames)} frames"
        yield (
            f"do not trust {which} of {total}: the radar points look like less than "
            f"{100 * (1 - STRANGE):.0f} % of the training frames. Is the radar "
            "calibrated, does it move, does another radar disturb it?"
        )


def _waveform(radar: RadarSpec) -> dict[str, float]:
    """Return what the look of a radar's points depends on, by its words in a note."""
    return {
        "range to {:.3g} m": radar.max_range_m,
        "range bins of {:.3g} m": radar.range_resolution_m,
        "velocity to {:.3g} m/s": radar.max_velocity_mps,
        "carrier at {:.3g} GHz": radar.center_frequency_hz / 1e9,
        "{:.0f} virtual antennas": radar.num_virtual,
    }


@contextlib.contextmanager
def _output(options: argparse.Namespace) -> Iterator[Callable[..., list[str]]]:
    """Yield the function that writes a frame: into a folder, or to one file of all."""
    if not is_streamed(options.output):
        yield _write
        return
    from jradar.stream.outputs import open_writer

    with contextlib.closing(open_writer(options.output)) as writer:
        yield functools.partial(_publish, writer)


def _publish(writer, recording, frame: int, _spec, drawn, options) -> list[str]:
    """Write the clouds and the picture of one frame to a file of all frames."""
    from jradar.stream.views import lidar_cloud, range_azimuth, recorded_view

    _, cloud, _, dense = drawn
    clouds = {"radar": cloud, "enhanced": dense}
    if (lidar := recordings.nearest_scan(recording, frame)) is not None:
        clouds["lidar"] = lidar_cloud(lidar)
    cube = jnp.asarray(recordings.calibrated_cube(recording, frame))
    picture = np.asarray(range_azimuth(cube, recording.radar))
    writer.write(recorded_view(recording, frame, clouds, picture))
    return [options.output]


def _write(recording, frame: int, spec: ModelSpec, drawn, options) -> list[str]:
    """Write the clouds, the range image and a picture of one frame."""
    from jradar import viz  # matplotlib loads while the stages compile
    from jradar.cli.writing import frame_folder, write_frame

    power, cloud, image, dense = drawn
    figure = viz.capture_figure(
        power,
        recording.radar,
        cloud,
        spec.fine,
        dense=dense,
        lidar=recordings.nearest_scan(recording, frame),
        title=f"{recording.name}, frame {frame}; model: {spec.purpose}",
    )
    image = np.where(dense.valid.reshape(image.shape), image, 0)
    return write_frame(
        frame_folder(options, frame),
        {"radar": cloud, "enhanced": dense},
        figure,
        kind=options.format,
        arrays={"range_image": image},
    )
