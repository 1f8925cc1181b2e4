"""From options to a recording, its frames and their radar points."""

import argparse
from typing import Any

import numpy as np
from jaxtyping import Array, Inexact

from jradar.errors import UsageError
from jradar.radar import (
    PointSpec,
    points_and_report,
    radar_points,
    strongest_echoes,
)
from jradar.recordings import (
    Recording,
    check_samples,
    open_recording,
    with_sample_doubts,
    without_background,
)
from jradar.types import PointCloud


def given(options: argparse.Namespace, *names: str) -> dict[str, Any]:
    """Return the options of these names that the user gave."""
    return {name: value for name in names if (value := getattr(options, name))}


def opening(options: argparse.Namespace) -> dict[str, Any]:
    """Return the options of `open_recording` that the user gave."""
    named = {"description": options.radar} if options.radar else {}
    return named | given(options, "sensor", "iq_order", "allow_partial", "device")


def open_frames(options: argparse.Namespace) -> tuple[Recording, range]:
    """Open the recording and return it with the frames of `--frame` or `--frames`.

    `--background` is subtracted from every frame that is read.
    Raises UsageError for a frame that the recording does not have.
    """
    recording = open_recording(
        options.path, frames_as_chirps=options.frames_as_chirps, **opening(options)
    )
    count, frame = len(recording.cubes), options.frame or 0
    frames = range(frame, frame + 1)
    if chosen := getattr(options, "frames", None):
        frames = range(*chosen.indices(count))
    if not frames or frames.start < 0 or frames.stop > count:
        asked = f"--frames from {chosen.start}" if chosen else f"--frame {frames.start}"
        raise UsageError(f"{asked}: {options.path} has frames 0 to {count - 1}")
    recording = with_sample_doubts(recording, frames[0])
    if background := getattr(options, "background", None):
        recording = without_background(recording, background)
    return recording, frames


def frame_report(
    cube: Inexact[Array | np.ndarray, "tx rx chirp sample"],
    recording: Recording,
    points: PointSpec,
    frame: int,
) -> tuple[PointCloud, dict[str, int]]:
    """Return `frame_points` and the counts of its `PointReport`, by their words.

    Saturated are the numbers that pile up at the end of the converter's scale, before
    calibration. Samples that are not finite were refused by the reader.
    """
    cloud, report = points_and_report(
        cube,
        recording.radar,
        points=points.fitted(recording.radar),
        coupling=recording.coupling,
        range_bias_m=recording.range_bias_m,
    )
    recorded = np.asarray(recording.cubes[frame])
    numbers = recorded.size * (1 + np.iscomplexobj(recorded))
    return cloud, {
        "detected": int(report.detected),
        "dropped": int(report.dropped),
        "saturated": round(check_samples(recorded).share * numbers),
    }


def frame_points(
    cube: Inexact[Array | np.ndarray, "tx rx chirp sample"],
    recording: Recording,
    points: PointSpec,
) -> PointCloud:
    """Return the radar points of a frame; windows and angle bins are fitted to it."""
    return radar_points(
        cube,
        recording.radar,
        points=points.fitted(recording.radar),
        coupling=recording.coupling,
        range_bias_m=recording.range_bias_m,
    )


def echoes(cloud: PointCloud, recording: Recording) -> list[dict[str, Any]]:
    """Return the strongest echoes of a cloud as rows of a table."""
    return [echo._asdict() for echo in strongest_echoes(cloud, recording.radar)]


def summary(recording: Recording, notes: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the first lines of a result: which recording was read."""
    return {
        "recording": str(recording.path),
        "radar": recording.radar.name,
        "frames": len(recording.cubes),
        "notes": [*recording.notes, *notes],
    }


def no_echoes(frames: list[int]) -> tuple[str, ...]:
    """Return a note about the frames in which nothing was detected, if there are any.

    `frames` are their numbers.
    """
    if not frames:
        return ()
    names = ", ".join(map(str, frames[:5])) + (", .." if frames[5:] else "")
    which = f"frame {names}" if len(frames) == 1 else f"{len(frames)} frames: {names}"
    return (f"no echoes in {which}: the detector found nothing, the clouds are empty",)
