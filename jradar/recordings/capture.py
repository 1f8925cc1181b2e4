"""A capture of your own rig: radar, LiDAR and poses in one folder.

Its `capture.toml` names the files and the places of the sensors, see `capture_toml`.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from jradar.errors import UsageError
from jradar.lidar import Poses, accumulate as merge, interpolate_poses
from jradar.recordings.bags import open_bag
from jradar.recordings.capture_toml import NAME, read_capture_toml, read_place
from jradar.recordings.dca1000 import open_dca1000
from jradar.recordings.formats import Format
from jradar.recordings.recording import Recording, Stream
from jradar.recordings.trajectory import read_tum

LATEST_S = 1e11  # seconds since 1970; a larger stamp is in another unit


def open_capture(folder: Path | str) -> Recording:
    """Open the recording that the `capture.toml` in `folder` describes.

    Raises UsageError for a wrong `capture.toml`, and ValueError for damaged files.
    """
    path = Path(folder)
    path = path if path.name == NAME else path / NAME
    if not path.is_file():
        raise FileNotFoundError(f"no such description of a capture: {path}")
    tables = read_capture_toml(path)
    radar, lidar = tables["radar"], tables.get("lidar")
    options = ("device", "iq_order", "allow_partial")
    recording = open_dca1000(
        path.parent / radar["file"],
        path.parent / radar["description"],
        **{key: radar[key] for key in options if key in radar},
    )
    notes = [*recording.notes]
    recording = recording._replace(
        name=path.parent.resolve().name,
        path=path.parent,
        base_from_radar=read_place(path, "radar", radar),
    )
    if "poses" in tables:
        poses = read_tum(path.parent / tables["poses"]["file"])
        recording = recording._replace(poses=poses)
    lidar_stamps = np.zeros(0)
    if lidar:
        clouds = open_bag(path.parent / lidar["file"], topic=lidar.get("topic"))
        notes += clouds.notes
        base_from_lidar = read_place(path, "lidar", lidar)
        lidar_stamps = clouds.stamps
        near = lidar.get("accumulate", 1)
        if near > 1 and recording.poses is None:
            notes.append(f"no poses: {near} clouds are merged as if nothing moved")
        stream = accumulate(clouds, near, recording.poses, base_from_lidar)
        recording = recording._replace(lidar=stream, base_from_lidar=base_from_lidar)
    stamps, doubts = _radar_stamps(path, radar, recording, lidar_stamps)
    cubes = Stream(recording.cubes.__getitem__, len(recording.cubes), stamps)
    return recording._replace(cubes=cubes, notes=(*notes, *doubts))


READER = Format(
    f"a folder with a {NAME}",
    lambda path: path.name == NAME or (path / NAME).is_file(),
    open_capture,
)


def accumulate(
    clouds: Stream,
    near: int,
    poses: Poses | None,
    base_from_lidar: Float[np.ndarray, "4 4"],
) -> Stream:
    """Return each cloud merged with its neighbours, `near` in all, in its own frame.

    With poses, neighbours are moved by the motion between the stamps, and neighbours
    without a pose are left out. Without poses they are merged unmoved.
    """
    if near < 1:
        raise UsageError(f"accumulate = {near} clouds, expected 1 or more")
    if near == 1:
        return clouds
    lidar = None
    if poses is not None and clouds.stamps is not None:
        lidar = interpolate_poses(poses, clouds.stamps) @ base_from_lidar

    def read(index: int) -> Float[np.ndarray, "point 4"]:
        first = max(index - (near - 1) // 2, 0)
        around = range(first, min(index + near // 2 + 1, len(clouds)))
        moves = np.stack([np.eye(4)] * len(around))
        for place, other in enumerate(around):
            if lidar is not None and other != index:
                moves[place] = np.linalg.solve(lidar[index], lidar[other])
        return merge([clouds[other] for other in around], moves)

    return Stream(read, len(clouds), clouds.stamps)


def _radar_stamps(path, radar, recording, lidar_stamps):
    """Return the times of the radar's frames on the LiDAR's clock, and doubts."""
    period = radar.get("frame_period_s", recording.radar.frame_period_s)
    given = [key for key in ("start_time_s", "offset_s") if key in radar]
    if not period > 0:
        raise UsageError(
            f"{path}: the time between frames is unknown: set frame_period_s in [radar]"
        )
    if len(given) == 2:
        raise UsageError(
            f"{path}: [radar] has start_time_s and offset_s: keep one of them"
        )
    if radar.get("start_time_s", 0) > LATEST_S:
        raise UsageError(
            f"{path}: [radar] start_time_s = {radar['start_time_s']}, expected "
            "seconds: are they milliseconds or nanoseconds?"
        )
    if "offset_s" in given and not len(lidar_stamps):
        raise UsageError(
            f"{path}: [radar] offset_s counts from the first LiDAR cloud, but there "
            "are no clouds: set start_time_s instead"
        )
    first = lidar_stamps[0] if len(lidar_stamps) else 0.0
    start = radar.get("start_time_s", first + radar.get("offset_s", 0.0))
    stamps, doubts = start + np.arange(len(recording.cubes)) * period, []
    if len(lidar_stamps) and not given:
        doubts.append("no start_time_s: the radar is assumed to start with the LiDAR")
    if len(lidar_stamps) and (stamps[-1] < first or stamps[0] > lidar_stamps[-1]):
        doubts.append(
            f"the radar's frames, {stamps[0]:.3f} to {stamps[-1]:.3f} s, and the "
            f"clouds, {first:.3f} to {lidar_stamps[-1]:.3f} s, do not overlap in time"
        )
    return stamps, doubts
