"""Opens the recording, and the frames of it, that the options name."""

import argparse
from typing import TYPE_CHECKING, Any

import jradar
from jradar.errors import UsageError

if TYPE_CHECKING:
    from jradar.recordings import Recording


def given(options: argparse.Namespace, *names: str) -> dict[str, Any]:
    """Return the options of these names that the user gave."""
    return {name: value for name in names if (value := getattr(options, name))}


def opening(options: argparse.Namespace) -> dict[str, Any]:
    """Return the options of `open_recording` that the user gave."""
    named = {"description": options.radar} if options.radar else {}
    return named | given(
        options, "sensor", "iq_order", "allow_partial", "device", "topic"
    )


def open_frames(options: argparse.Namespace) -> "tuple[Recording, range]":
    """Open the recording and return it with the frames of `--frame` or `--frames`.

    `--background` is subtracted from every frame that is read.
    Raises UsageError for a frame that the recording does not have.
    """
    recording = jradar.open_recording(
        options.path, frames_as_chirps=options.frames_as_chirps, **opening(options)
    )
    count, frame = len(recording.frames), options.frame or 0
    frames = range(frame, frame + 1)
    if chosen := getattr(options, "frames", None):
        frames = range(*chosen.indices(count))
    if not frames or frames.start < 0 or frames.stop > count:
        asked = f"--frames from {chosen.start}" if chosen else f"--frame {frames.start}"
        raise UsageError(f"{asked}: {options.path} has frames 0 to {count - 1}")
    if background := getattr(options, "background", None):
        recording = jradar.recordings.without_background(recording, background)
    return recording, frames


def summary(recording: "Recording", notes: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the first lines of a result: which recording was read."""
    return {
        "recording": str(recording.path),
        **({} if recording.radar is None else {"radar": recording.radar.spec.name}),
        "frames": len(recording.frames),
        "notes": [*recording.notes, *notes],
    }
