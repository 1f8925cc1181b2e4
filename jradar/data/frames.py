"""Radar frames matched with LiDAR scans, and prepared (sections III-A, V-A)."""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float, Inexact, Int

from jradar.compiled import jit
from jradar.data.records import PreparedFrame
from jradar.data.spec import PrepareSpec
from jradar.lidar import LidarSpec, interpolate_poses, preprocess
from jradar.lidar.preprocess import LidarSteps, aligned
from jradar.radar import Cells, Radar, all_cells, cell_points, detect
from jradar.recordings.recording import Recording, Stream, radar_from_lidar
from jradar.types import PointCloud

MAX_DROPPED = 0.5  # largest fraction of radar frames that may be dropped
NO_ECHO, NO_RETURN = "all radar samples are zero", "no LiDAR point is in view"
NO_POINT = "the radar sent no points"
NOTHING_SEEN = NO_ECHO, NO_POINT, NO_RETURN
NO_PLACE = (
    "it is not known where the LiDAR is on the rig, so it is taken to be where the "
    "radar is: give the places of both in a capture.toml or in the bag's /tf_static"
)


class EmptyFrame(ValueError):
    """A sensor saw nothing at the time of a frame, so the frame is left out."""

    def __init__(self, name: str, frame: int, reason: str):
        """`name` is the recording's."""
        self.reason = reason
        super().__init__(f"{name}, frame {frame}: {reason}")


class Matches(NamedTuple):
    """Matched radar frames in rising order, and why the others were dropped."""

    radar: Int[np.ndarray, " match"]
    lidar: Int[np.ndarray, " match"]
    dropped: dict[int, str]  # radar frame: reason


def matches_of(recording: Recording, spec: PrepareSpec) -> Matches:
    """Return the matched frames; ValueError without LiDAR or time stamps."""
    stamps, _, lidar_stamps = _timed(recording)
    span = (-np.inf, np.inf)
    if recording.poses is not None:
        span = tuple(recording.poses.stamps[[0, -1]].tolist())
    return match_nearest(stamps, lidar_stamps, tolerance_s=spec.tolerance_s, span=span)


def notes_of(recording: Recording) -> list[str]:
    """Return the recording's notes, and one if the place of its LiDAR is unknown."""
    unknown = recording.lidar is not None and radar_from_lidar(recording) is None
    return [*recording.notes, *([NO_PLACE] if unknown else [])]


def match_nearest(
    radar_stamps: Float[np.ndarray, " radar"],
    lidar_stamps: Float[np.ndarray, " lidar"],
    *,
    tolerance_s: float = 0.05,
    span: tuple[float, float] = (-np.inf, np.inf),
) -> Matches:
    """Match each radar frame with the nearest LiDAR scan, on the host.

    A scan is used once: the closest pairs are matched first. Frames without a scan
    within `tolerance_s` and frames outside `span` (start and end of the trajectory in
    seconds) are dropped. Stamps may be in any order. Raises ValueError for stamps that
    are not finite.
    """
    radar, lidar = np.asarray(radar_stamps, float), np.asarray(lidar_stamps, float)
    for name, stamps in (("radar", radar), ("LiDAR", lidar)):
        if bad := np.flatnonzero(~np.isfinite(stamps)).size:
            raise ValueError(f"{bad} of {len(stamps)} {name} stamps are not finite")
    order = np.argsort(lidar, kind="stable")
    rising = lidar[order]
    first = np.searchsorted(rising, radar - tolerance_s)
    last = np.searchsorted(rising, radar + tolerance_s, side="right")
    inside = (radar >= span[0]) & (radar <= span[1])
    candidates = sorted(
        (abs(rising[j] - radar[i]), i, int(order[j]))
        for i in np.flatnonzero(inside).tolist()
        for j in range(first[i], last[i])
    )
    partner, taken, reasons = {}, set(), {}
    for i in range(len(radar)):
        none = f"no LiDAR scan within {1e3 * tolerance_s:g} ms"
        reasons[i] = none if inside[i] else "outside the trajectory"
    for _, i, j in candidates:
        reasons[i] = "its LiDAR scan is closer to another radar frame"
        if i not in partner and j not in taken:
            partner[i] = j
            taken.add(j)
    frames = np.array(sorted(partner), int)
    scans = np.array([partner[i] for i in frames], int)
    dropped = {i: why for i, why in reasons.items() if i not in partner}
    return Matches(frames, scans, dropped)


def check_dropped(name: str, num_frames: int, dropped: dict[int, str]) -> None:
    """Raise ValueError with the reasons if more than half of the frames are dropped.

    Frames in which a sensor saw nothing do not count: they do not show the clocks.
    """
    reasons = [why for why in dropped.values() if why not in NOTHING_SEEN]
    if len(reasons) > MAX_DROPPED * num_frames:
        counts = ", ".join(f"{reasons.count(r)} {r}" for r in dict.fromkeys(reasons))
        raise ValueError(
            f"{name}: {len(reasons)} of {num_frames} radar frames are dropped "
            f"({counts}), expected at most half: do the two clocks agree?"
        )


def prepare_frame(
    recording: Recording, radar_index: int, lidar_index: int, spec: PrepareSpec
) -> tuple[PreparedFrame, LidarSteps, Float[np.ndarray, "echo 3"]]:
    """Prepare one radar frame with its LiDAR scan, on the host.

    Also returns the steps of the LiDAR's preparation and the radar points that the
    visibility filter trusted. It trusts all points that a radar sent. Raises ValueError
    without LiDAR or time stamps, and EmptyFrame for radar samples that are all zero, a
    radar that sent no points, or a scan without a point in view.
    """
    stamps, lidar, lidar_stamps = _timed(recording)
    stamp, lidar_stamp = float(stamps[radar_index]), float(lidar_stamps[lidar_index])
    cells, cloud, trusted, range_bias_m = _measured(recording, radar_index, spec)
    world_from_radar, world_from_lidar = sensor_poses(recording, stamp, lidar_stamp)
    trusted_xyz = np.asarray(trusted.xyz)[np.asarray(trusted.valid)]
    steps = preprocess(
        lidar[lidar_index][:, :3],
        trusted_xyz,
        radar_from_lidar=np.linalg.inv(world_from_radar) @ world_from_lidar,
        spec=spec.lidar,
    )
    if not steps.in_view.any():
        raise EmptyFrame(recording.name, radar_index, NO_RETURN)
    if recording.poses is None:
        world_from_radar = np.full((4, 4), np.nan)
    frame = PreparedFrame(
        sequence=recording.name,
        frame=radar_index,
        stamp=stamp,
        lidar_stamp=lidar_stamp,
        world_from_radar=world_from_radar,
        cells=cells,
        radar=cloud,
        lidar_xyz=steps.xyz[steps.visible],
        range_bias_m=range_bias_m,
    )
    return frame, steps, trusted_xyz


def _measured(
    recording: Recording, index: int, spec: PrepareSpec
) -> tuple[Cells | None, PointCloud, PointCloud, float]:
    """Return cells, the condition's and the trusted cloud, and the bias of ranges."""
    measured = recording.frames[index]
    if isinstance(measured, PointCloud):
        if not np.any(measured.valid):
            raise EmptyFrame(recording.name, index, NO_POINT)
        cloud = measured.padded()  # as records are read: few sizes are compiled
        return None, cloud, cloud, 0.0
    if not np.any(measured):
        raise EmptyFrame(recording.name, index, NO_ECHO)
    found = radar_side(measured, recording.radar, spec)
    return *jax.tree.map(np.asarray, found), float(recording.radar.range_bias_m)


def lidar_in_view(
    recording: Recording, prepared: PreparedFrame, spec: LidarSpec
) -> Float[np.ndarray, "point 3"]:
    """Return all LiDAR points in the field of view of a frame that was prepared; host.

    They are in the radar's frame, floor and ceiling included.
    """
    _, lidar, stamps = _timed(recording)
    index = int(np.argmin(np.abs(np.asarray(stamps) - prepared.lidar_stamp)))
    radar, scanner = sensor_poses(recording, prepared.stamp, prepared.lidar_stamp)
    transform = np.linalg.inv(radar) @ scanner
    xyz, seen = aligned(lidar[index][:, :3], radar_from_lidar=transform, spec=spec)
    return xyz[seen]


def _timed(recording: Recording) -> tuple[np.ndarray, Stream, np.ndarray]:
    """Return the radar's time stamps, the LiDAR's scans and their time stamps."""
    lidar, frames = recording.lidar, recording.frames
    if lidar is None or lidar.stamps is None or frames.stamps is None:
        lacks = "no LiDAR" if lidar is None else "no time stamps"
        raise ValueError(
            f"{recording.path} has {lacks}: training pairs need both sensors and their "
            "times; describe the recording in a capture.toml"
        )
    return frames.stamps, lidar, lidar.stamps


def sensor_poses(
    recording: Recording, stamp: float, lidar_stamp: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return world from radar and world from LiDAR, each at its own time, on the host.

    Without a trajectory the rig is at rest and its base is the world.
    """
    radar, lidar = recording.base_from_radar, recording.base_from_lidar
    radar = np.eye(4) if radar is None else radar
    lidar = np.eye(4) if lidar is None else lidar
    if recording.poses is None:
        return radar, lidar
    base = interpolate_poses(recording.poses, np.array([stamp, lidar_stamp]))
    if not np.isfinite(base[1]).all():  # a scan just beyond the trajectory's end
        base[1] = base[0]
    return base[0] @ radar, base[1] @ lidar


@jit(static_argnames="spec")
def radar_side(
    cube: Inexact[Array | np.ndarray, "tx rx chirp sample"],
    radar: Radar,
    spec: PrepareSpec,
) -> tuple[Cells, PointCloud, PointCloud]:
    """Return the cells, the condition's cloud and the visibility filter's cloud."""
    condition, trusted = (
        points.fitted(radar.spec) for points in (spec.points, spec.visible_points)
    )
    cells = all_cells(cube, radar, points=condition)
    trusted_cells = cells
    if condition.angles != trusted.angles:
        trusted_cells = all_cells(cube, radar, points=trusted)

    def cloud(cells, points):
        seen = points.subtracting(radar.leakage)
        mask = detect(cells.power, radar.spec, points=seen)
        return cell_points(cells, mask, radar, points=points)

    return cells, cloud(cells, condition), cloud(trusted_cells, trusted)


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
    wanted = range(*frames.indices(len(recording.frames)))
    pairs = zip(matches.radar.tolist(), matches.lidar.tolist(), strict=True)
    for radar, lidar in pairs:
        if radar in wanted:
            prepared = prepare_frame(recording, radar, lidar, spec)
            return Preview(*prepared, len(matches.radar))
    reason = next(iter(matches.dropped.values()), "no frame is in --frames")
    raise ValueError(
        f"{recording.path}: none of the chosen frames has a LiDAR scan: {reason}"
    )
