"""Poses next to frames of points: TUM's format, or a 4 x 4 array a frame."""

from pathlib import Path

import numpy as np
import scipy  # loads `spatial` when it is first used
from jaxtyping import Float

from jradar.errors import UsageError, parsing
from jradar.files import open_file
from jradar.lidar import Poses
from jradar.recordings.recording import clocks_apart
from jradar.recordings.text_files import MAX_POSES_BYTES, read_tum

STEP_S = 0.1  # between frames without times, so that they have poses
IN_FOLDER = ("poses.txt", "poses.tum", "poses.npy")
BESIDE = (".tum", "_poses.txt", "_poses.npy")  # after the stem of a file

Stamps = Float[np.ndarray, " frame"] | None


def found_poses(
    path: Path, count: int, stamps: Stamps
) -> tuple[Poses | None, Stamps, tuple[str, ...]]:
    """Return the radar's poses next to `count` frames, the frames' times, and notes.

    Frames without times get some with a 4 x 4 array. Raises UsageError for an array of
    another length, and ValueError for damaged files.
    """
    names = [path / name for name in IN_FOLDER]
    if not path.is_dir():
        names = [path.with_name(path.stem + end) for end in BESIDE]
    file = next((name for name in names if name.is_file()), None)
    if file is None:
        return None, stamps, ()
    said = f"poses of the radar are those of {file.name}"
    if file.suffix != ".npy":
        poses = read_tum(file)
        if stamps is None:
            return None, None, (f"{file.name} is not used: the frames have no times",)
        spans = clocks_apart(stamps, poses.stamps)
        return (
            poses,
            stamps,
            (said, *([f"their clock does not match: {spans}"] if spans else [])),
        )
    with open_file(file, limit=MAX_POSES_BYTES), parsing(file, "a .npy of poses"):
        matrices = np.load(file, allow_pickle=False)
    poses, stamps, notes = poses_of_matrices(file, matrices, count, stamps)
    return poses, stamps, (said, *notes)


def poses_of_matrices(
    path: Path, matrices: np.ndarray, count: int, stamps: Stamps
) -> tuple[Poses, Stamps, tuple[str, ...]]:
    """Return the poses of `count` frames, their times, and a note if those are assumed.

    Raises UsageError for arrays of another shape, ValueError for no rotations.
    """
    if matrices.shape != (count, 4, 4):
        raise UsageError(
            f"{path}: poses of shape {matrices.shape}, expected one of 4 x 4 for each "
            f"of {count} frames"
        )
    notes = ()
    if stamps is None:
        stamps = STEP_S * np.arange(count)
        notes = (f"the frames have no times: {STEP_S:g} s between them are assumed",)
    turns = matrices[:, :3, :3]
    if not np.allclose(turns @ np.swapaxes(turns, 1, 2), np.eye(3), atol=1e-2):
        raise ValueError(f"{path}: its 4 x 4 arrays are not rotations and shifts")
    turns = scipy.spatial.transform.Rotation.from_matrix(turns).as_quat()
    return Poses(stamps, matrices[:, :3, 3].astype(float), turns), stamps, notes
