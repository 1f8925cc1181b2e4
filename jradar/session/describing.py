"""A recording and one of its frames in words and numbers, as `jradar info` does."""

from typing import Any

from jradar.motion import gravity_warnings
from jradar.radar import PointSpec
from jradar.recordings import Recording, describe, propose_offset
from jradar.session.detecting import detect_recording
from jradar.session.warnings import no_echoes

LEAST_CONFIDENCE = 0.1  # of an offset between two clocks


def describe_recording(recording: Recording, *, frame: int = 0) -> dict[str, Any]:
    """Return `describe`, and a frame's samples, noise and strongest echoes.

    For a rig's own capture with a LiDAR, also the offset between the sensors' clocks.
    """
    radar, one = recording.radar.spec, range(frame, frame + 1)
    detection = detect_recording(recording, frames=one)
    (seen,) = detection
    shown = seen.describe(radar)
    found: dict[str, Any] = {
        "frame": frame,
        "largest sample": seen.check.largest,
        "share at full scale": seen.check.share,
        "noise": shown["noise"],
        "echoes": shown["echoes"],
    }
    if radar.num_chirps > 1:
        moving = PointSpec(remove_static=True)
        (seen_moving,) = detect_recording(recording, points=moving, frames=one)
        found["moving echoes"] = seen_moving.describe(radar)["echoes"]
    if (recording.path / "capture.toml").is_file() and recording.lidar is not None:
        found["time offset"] = _time_offset(recording)
    described = describe(detection.recording)
    described["notes"] += gravity_warnings(recording)
    described["notes"] += no_echoes([frame] if seen.empty else [])
    return {**described, **found}


def _time_offset(recording: Recording) -> dict[str, Any]:
    """Estimate the offset between the sensors' clocks from the rig's motion."""
    try:
        seconds, confidence = propose_offset(recording)
    except ValueError as error:
        return {"not estimated": str(error)}
    if confidence < LEAST_CONFIDENCE:
        return {"not estimated": f"no offset stands out (confidence {confidence:.3f})"}
    return {"add to the radar's start (s)": seconds, "confidence, 0 to 1": confidence}
