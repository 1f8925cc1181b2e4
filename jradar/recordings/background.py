"""A recording without the static background of its own frames."""

import dataclasses

import numpy as np

from jradar.errors import UsageError
from jradar.radar import static_background, subtract_background
from jradar.recordings.recording import Recording, Stream


def without_background(recording: Recording, frames: slice) -> Recording:
    """Return the recording of a radar that stands still without what stands still.

    The background is the mean of `frames`; it contains the leakage, which is dropped.
    Raises UsageError if the recording has none of the frames.
    """
    cubes, chosen = recording.cubes, range(*frames.indices(len(recording.cubes)))
    if not chosen:
        raise UsageError(
            f"no background in frames {frames.start or 0} and later: {recording.path} "
            f"has frames 0 to {len(cubes) - 1}"
        )
    background = static_background(cubes[i] for i in chosen)

    def read(frame: int) -> np.ndarray:
        return np.asarray(subtract_background(cubes[frame], background))

    note = f"the mean of frames {chosen[0]} to {chosen[-1]} is subtracted as background"
    return recording._replace(
        cubes=Stream(read, len(cubes), cubes.stamps, cubes.notes),
        radar=dataclasses.replace(recording.radar, leakage=None),
        notes=(*recording.notes, note),
    )
