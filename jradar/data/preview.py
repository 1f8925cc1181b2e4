"""One prepared frame with the steps that led to it, to look at before all others."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jradar.data.frames import matches_of, prepare_frame
from jradar.data.records import PreparedFrame
from jradar.data.spec import PrepareSpec
from jradar.lidar import LidarSteps
from jradar.recordings import Recording


class Preview(NamedTuple):
    """A prepared frame; `viz.preparation_figure` draws the steps."""

    frame: PreparedFrame
    steps: LidarSteps
    trusted: Float[np.ndarray, "echo 3"]  # radar points of the visibility filter
    matched: int  # frames of the recording with a LiDAR scan

    def describe(self) -> dict[str, int]:
        """Return how many points each step keeps."""
        steps = self.steps
        return {
            "frame": self.frame.frame,
            "radar points": len(self.trusted),
            "LiDAR points": len(steps.xyz),
            "in the radar's view": int(steps.in_view.sum()),
            "floor and ceiling": int((steps.ground | steps.ceiling).sum()),
            "kept": len(self.frame.lidar_xyz),
            "matched frames": self.matched,
        }


def preview(
    recording: Recording, spec: PrepareSpec, *, frames: slice = slice(None)
) -> Preview:
    """Prepare the first of the `frames` that has a LiDAR scan; host.

    Raises ValueError, with the reason, if none has.
    """
    matches = matches_of(recording, spec)
    wanted = range(*frames.indices(len(recording.cubes)))
    pairs = zip(matches.radar.tolist(), matches.lidar.tolist(), strict=True)
    for radar, lidar in pairs:
        if radar in wanted:
            prepared = prepare_frame(recording, radar, lidar, spec)
            return Preview(*prepared, len(matches.radar))
    reason = next(iter(matches.dropped.values()), "no frame is in --frames")
    raise ValueError(
        f"{recording.path}: none of the chosen frames has a LiDAR scan: {reason}"
    )
