"""Single frames of DREAM-PCD with their poses, packed into one NPZ.

    points [point][10]           world x y z, Doppler, range, power, azimuth, elevation
                                 in degrees, two more
    frame [point]                the number of its frame, rising
    frame_ids [frame]            numbers of frames, consecutive
    world_from_radar [frame][4][4]

x right, y forward, z up. Range and angles are the radar's, and place the points. The
set has no times: 10 frames a second are assumed, and its velocities are 1.6 times those
of its poses then.
"""

from pathlib import Path

import numpy as np

from jradar.errors import parsing
from jradar.recordings.points.fields import FORWARD
from jradar.recordings.points.frames import points_recording
from jradar.recordings.points.packed import holds_arrays, read_arrays
from jradar.recordings.points.poses import poses_of_matrices
from jradar.recordings.recording import Format, Recording, Stream

MAX_BYTES = 1 << 30
ARRAYS = ("points", "frame", "frame_ids", "world_from_radar")
COLUMNS = 10
DOPPLER, RANGE, POWER, AZIMUTH, ELEVATION = range(3, 8)
SCALE = "velocities are about 1.6 times those of the poses at that rate, in all frames"


def open_dream_pcd(path: Path | str) -> Recording:
    """Open the frames of a packed file; ValueError if its arrays do not fit."""
    path = Path(path)
    with parsing(path, "a packed .npz of DREAM-PCD"):
        arrays = read_arrays(path, ARRAYS, limit=MAX_BYTES)
        points, frame, numbers, matrices = arrays.values()
        if points.shape != (len(frame), COLUMNS) or (np.diff(frame) < 0).any():
            raise ValueError(f"points of shape {points.shape}, of {len(frame)} frames")
        turn = np.eye(4)
        turn[:3, :3] = FORWARD["y"]
        poses, stamps, notes = poses_of_matrices(
            path, turn @ matrices @ turn.T, len(numbers), None
        )
    starts = np.searchsorted(frame, numbers)
    ends = np.searchsorted(frame, numbers, "right")

    def read(index: int) -> dict[str, np.ndarray]:
        rows = points[starts[index] : ends[index]]
        return {
            "range": rows[:, RANGE],
            "azimuth": -rows[:, AZIMUTH],  # of the file's are to the right
            "elevation": rows[:, ELEVATION],
            "doppler": rows[:, DOPPLER],
            "power": rows[:, POWER],
        }

    return points_recording(
        path,
        Stream(read, len(numbers), stamps, (*notes, SCALE)),
        poses=poses,
        base_from_radar=np.eye(4),
    )


READER = Format(
    "frames of DREAM-PCD, packed as .npz",
    lambda path: holds_arrays(path, ARRAYS),
    open_dream_pcd,
)
