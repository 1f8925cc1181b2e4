"""`jradar enhance`: frames of a recording through a model, every stage timed."""

import argparse
import contextlib
import functools
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from jradar import recordings
from jradar.cli.limits import check_limits, within_limits
from jradar.cli.paths import is_streamed
from jradar.cli.reading import open_frames, summary
from jradar.cli.writing import check_flat, write_frame
from jradar.model import Model, load_model
from jradar.progress import progress
from jradar.recordings import Recording
from jradar.session import Frame, enhance_recording


def enhance_frames(options: argparse.Namespace) -> dict[str, Any]:
    """Enhance the frames that the options name, and write the results."""
    check_limits(options)
    check_flat(options)
    if is_streamed(options.output) and options.frame is None:
        options.frames = options.frames or slice(None)
    model = load_model(options.model)
    recording, frames = open_frames(options)
    pictured = options.picture
    if pictured is None:  # a single frame that has a folder
        pictured = not (options.frames or options.flat)
    found = enhance_recording(
        recording,
        model,
        frames=frames,
        seed=options.seed,
        fuse=options.fuse,
        draws=options.draws,
        steps=options.steps,
        least_confidence=options.min_confidence,
        remove_interference=options.remove_interference or None,
        anyway=options.anyway,
    )
    rows, written = list[dict[str, Any]](), list[str]()
    begin = time.perf_counter()
    with (
        _output(options, found.recording, model, pictured=pictured) as write,
        progress("enhancing", len(frames), unit="frames") as show,
    ):
        for frame in found:
            frame = frame._replace(
                points=within_limits(frame.points, options),
                cloud=within_limits(frame.cloud, options),
            )
            rows.append(_row(frame))
            written = found.watch("writing", write, frame)
            if len(frames) > 1:
                show(len(rows))
    seconds = time.perf_counter() - begin
    times = found.times
    compiling = times.pop("compiling")
    motion = {"frames fused": options.fuse, "motion by": found.motion}
    return {
        **summary(found.recording, found.warnings),
        "model": {
            "name": str(options.model),
            "purpose": model.card.purpose,
            "training steps": model.card.steps_seen,
            "trained on": f"{model.card.trained_on}, radar {model.card.radar.name}",
        },
        **(motion if options.fuse > 1 else {}),
        **({"enhanced": rows} if options.frames else rows[0]),
        "milliseconds per frame": {name: 1e3 * took for name, took in times.items()},
        "compiling (s)": compiling,
        "frames/s": len(rows) / seconds,
        "written": [options.output] if options.frames else written,
    }


def _row(frame: Frame) -> dict[str, Any]:
    """What the table shows of a frame."""
    row: dict[str, Any] = {
        "frame": frame.number,
        "detections": frame.detections,
        "radar points": int(np.asarray(frame.points.valid).sum()),
        "enhanced points": int(np.asarray(frame.cloud.valid).sum()),
    }
    if frame.confidence is not None:
        row["confidence (%)"] = round(100 * frame.confidence, 1)
    if frame.unlikeness is not None:
        row["unlike training (%)"] = round(100 * frame.unlikeness, 1)
    return row


@contextlib.contextmanager
def _output(
    options: argparse.Namespace, recording: Recording, model: Model, *, pictured: bool
) -> Iterator[Callable[[Frame], list[str]]]:
    """Yield the function that writes a frame: into a folder, or to one file of all."""
    if not is_streamed(options.output):
        yield functools.partial(
            _write, options, recording=recording, model=model, pictured=pictured
        )
        return
    from jradar.stream.outputs import open_writer

    with contextlib.closing(open_writer(options.output)) as writer:
        yield functools.partial(_publish, options, writer, recording)


def _publish(options, writer, recording: Recording, frame: Frame) -> list[str]:
    """Write the clouds and the picture of one frame to a file of all frames."""
    from jradar.stream.views import lidar_cloud, range_azimuth, recorded_view

    clouds = {"radar": frame.points, "enhanced": frame.cloud}
    if (lidar := recordings.nearest_scan(recording, frame.number)) is not None:
        clouds["lidar"] = lidar_cloud(lidar)
    picture = np.asarray(range_azimuth(frame.samples, recording.radar.spec))
    writer.write(recorded_view(recording, frame.number, clouds, picture))
    return [options.output]


def _write(
    options, frame: Frame, *, recording: Recording, model: Model, pictured: bool
) -> list[str]:
    """Write the clouds, the range image and a picture of one frame."""
    image = frame.image.range_m
    kept = np.asarray(frame.cloud.valid).reshape(image.shape)
    return write_frame(
        options,
        frame.number,
        {"radar": frame.points, "enhanced": frame.cloud},
        functools.partial(_picture, recording, model, frame) if pictured else None,
        arrays={"range_image": np.where(kept, image, 0)},
    )


def _picture(recording: Recording, model: Model, frame: Frame):
    """The range-Doppler map and both clouds, with the LiDAR's where there is one."""
    from jradar import viz

    return viz.capture_figure(
        frame.power,
        recording.radar.spec,
        frame.points,
        model.spec.fine,
        dense=frame.cloud,
        lidar=recordings.nearest_scan(recording, frame.number),
        title=f"{recording.name}, frame {frame.number}; model: {model.card.purpose}",
    )
