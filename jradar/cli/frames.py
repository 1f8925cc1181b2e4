"""`jradar points` and `jradar enhance` turn frames of a recording into clouds."""

import argparse
import contextlib
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import jradar
from jradar.cli.groups import given_drawing, given_points
from jradar.cli.paths import is_streamed
from jradar.cli.reading import open_frames, summary
from jradar.errors import UsageError
from jradar.outputs.guard import GuardedFolder
from jradar.progress import progress

if TYPE_CHECKING:
    from jradar.outputs.frame_folder import FrameFolder
    from jradar.pipeline import Enhancement, Frame
    from jradar.recordings import Recording


def points(options: argparse.Namespace) -> dict[str, Any]:
    """Detect points in radar frames; write them as clouds, with a picture."""
    limits = _limits(options)
    try:
        spec = jradar.radar.PointSpec(**given_points(options))
    except ValueError as error:
        raise UsageError(str(error)) from error
    recording, frames = open_frames(options)
    jradar.recordings.need_samples(recording)
    folder = _folder(options, recording, frames, "radar")
    found = jradar.pipeline.detect_recording(recording, points=spec, frames=frames)
    recording, radar = found.recording, recording.radar.spec
    deviations = spec if options.deviations else None
    rows, written = list[dict[str, Any]](), list[str]()
    with progress("detecting", len(frames), unit="frames") as show:
        for frame in found:
            if limits:
                frame = frame._replace(points=frame.points.within(**limits))
            written = folder.write_detected(frame, recording, deviations=deviations)
            rows.append(frame.describe(radar))
            if len(frames) > 1:
                show(len(rows))
    shown = {**rows[0], "written": written}
    if options.frames:
        detected = [_short(row) for row in rows]
        shown = {"detected": detected, "written": [options.output]}
    return {**summary(recording, found.warnings), **shown}


def _short(row: dict[str, Any]) -> dict[str, Any]:
    """Return what a table of several frames shows of one."""
    strongest = row["echoes"][0] if row["echoes"] else {}
    shown = ("frame", "points", "detected", "dropped", "saturated")
    return {
        **{name: row[name] for name in shown},
        "noise floor (dB)": row["noise"]["floor_db"],
        "strongest echo (m)": strongest.get("range_m"),
        "SNR (dB)": strongest.get("snr_db"),
    }


def enhance(options: argparse.Namespace) -> dict[str, Any]:
    """Turn radar frames into dense point clouds with a trained model."""
    limits, streamed = _limits(options), is_streamed(options.output)
    if options.flat and streamed:
        raise UsageError(f"--flat writes a folder, but {options.output} is one file")
    if options.flat and options.picture:
        raise UsageError("--flat writes clouds alone: leave out --flat or --picture")
    if streamed and options.frame is None:
        options.frames = options.frames or slice(None)
    model = jradar.load_model(options.model)
    recording, frames = open_frames(options)
    pictured = not options.frames if options.picture is None else options.picture
    folder = None
    if not streamed:
        clouds = ("radar", "enhanced")
        folder = _folder(options, recording, frames, *clouds, pictured=pictured)
    found = jradar.enhance_recording(
        recording,
        model,
        frames=frames,
        seed=options.seed,
        fuse=options.fuse,
        history_s=options.history,
        remove_interference=options.remove_interference or None,
        anyway=options.anyway,
        **given_drawing(options),
    )
    rows, written = list[dict[str, Any]](), [options.output]
    begin = time.perf_counter()
    with (
        _writer(options, found, folder) as write,
        progress("enhancing", len(frames), unit="frames") as show,
    ):
        for frame in found:
            if limits:
                points, cloud = frame.points, frame.cloud
                frame = frame._replace(
                    points=points.within(**limits), cloud=cloud.within(**limits)
                )
            rows.append(frame.describe())
            paths = found.watch("writing", write, frame)
            written = written if options.frames else paths
            if len(frames) > 1:
                show(len(rows))
    seconds = time.perf_counter() - begin
    times = found.times
    compiling = times.pop("compiling")
    motion = {"motion by": found.motion}
    if options.fuse > 1:
        motion = {"frames fused": options.fuse, **motion}
    count, notes = len(recording.frames), found.warnings
    if not options.frames and count > 1:
        notes += (
            f"frame {rows[0]['frame']} of {count} is enhanced: --frames : for all",
        )
    return {
        **summary(found.recording, notes),
        "model": {
            "name": str(options.model),
            "purpose": model.card.purpose,
            "training steps": model.card.steps_seen,
            "trained on": f"{model.card.trained_on}, radar {model.card.radar.name}",
        },
        **(motion if found.motion else {}),
        **({"enhanced": rows} if options.frames else rows[0]),
        "milliseconds per frame": {name: 1e3 * took for name, took in times.items()},
        "compiling (s)": compiling,
        "frames/s": len(rows) / seconds,
        "written": written,
    }


@contextlib.contextmanager
def _writer(
    options: argparse.Namespace, found: "Enhancement", folder: "FrameFolder | None"
) -> "Iterator[Callable[[Frame], list[str]]]":
    """Yield the function that writes a frame, into a folder or one file of all."""
    if folder is not None:
        yield lambda frame: folder.write_enhanced(frame, found.recording, found.model)
        return
    from jradar.outputs.published import published_frame
    from jradar.outputs.writers import open_writer

    with contextlib.closing(open_writer(options.output, force=options.force)) as writer:

        def write(frame: "Frame") -> list[str]:
            writer.write(published_frame(found.recording, frame))
            return [options.output]

        yield write


def _folder(
    options: argparse.Namespace,
    recording: "Recording",
    frames: range,
    *clouds: str,
    pictured: bool = True,
) -> "FrameFolder":
    """Return the folder of the output; UsageError if it must not be replaced."""
    from jradar.outputs.frame_folder import FrameFolder

    return FrameFolder(
        GuardedFolder(options.output, options.command.__name__, force=options.force),
        clouds,
        frames,
        kind=options.format,
        several=bool(options.frames),
        flat=options.flat,
        pictured=pictured,
        radar=None if recording.of_points else recording.radar.spec,
    )


def _limits(options: argparse.Namespace) -> dict[str, float]:
    """Return the limits of `PointCloud.within` that the user gave.

    Raises UsageError if they leave no range.
    """
    nearest, farthest = options.min_range, options.max_range
    if None not in (nearest, farthest) and nearest >= farthest:
        raise UsageError(
            f"--min-range {nearest:g} --max-range {farthest:g}, expected the smaller "
            "one first"
        )
    found = {
        "min_range_m": nearest,
        "max_range_m": farthest,
        "max_azimuth": options.max_azimuth,
        "max_elevation": options.max_elevation,
    }
    return {name: value for name, value in found.items() if value is not None}
