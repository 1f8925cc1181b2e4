"""Maps of a recording: the radar's own, and the one that a LiDAR would have made."""

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from jradar.errors import UsageError, first_interrupt_noted
from jradar.files import atomic_path, write_text
from jradar.lidar import interpolate_poses
from jradar.mapping.loops import check_libraries, close_loops, path_lengths
from jradar.mapping.predict import (
    Occupied,
    column_grid,
    enhance_map,
    expected,
    likely_first,
)
from jradar.mapping.voxel_map import SensorModel, VoxelMap
from jradar.model import ColumnGrid, Model
from jradar.motion import (
    ego_velocity,
    frame_velocities,
    odometry,
    write_tum,
)
from jradar.motion.attitude import within_poses
from jradar.motion.trajectory import Trajectory
from jradar.outputs.clouds import write_ply
from jradar.pipeline import chosen_frames, detect_recording
from jradar.radar import PointSpec
from jradar.recordings import Recording
from jradar.types import PointCloud
from jradar.viz import maps_figure, save_figure

POINTS = PointSpec()
FASTEST_MPS = 50.0  # of a radar between two frames
JUMP_MPS = 3.0  # larger changes of velocity from frame to frame show that poses jump
SHORTEST_M = 1.0  # of a path that shows a place from several sides
FEWEST = 10  # frames of a map
BAND_M = (-0.3, 0.6)  # below and above the radar's path: what stands in a robot's way
FILES = (
    *("map.ply", "radar_map.ply", "grid.pgm", "grid.yaml", "map.json", "map.png"),
    "trajectory.tum",  # of frames with times
)
OCCUPIED, FREE, UNKNOWN = 0, 254, 205  # grey values of ROS's map_server

Points = Float[np.ndarray, "point 3"]


class RecordingMap(NamedTuple):
    """Both maps of a recording, in the world of its poses."""

    grid: ColumnGrid
    radar: Occupied
    enhanced: Occupied
    free: np.ndarray  # voxels [voxel, 3] that the radar looked through
    poses: Float[np.ndarray, "frame 4 4"]  # of the radar, with loops closed
    notes: tuple[str, ...]
    interrupted: bool = False  # by Ctrl-C, so that later frames are missing
    stamps: Float[np.ndarray, " frame"] | None = None  # of the poses, in seconds
    base_from_radar: Float[np.ndarray, "4 4"] | None = None  # None is unknown

    @property
    def path(self) -> Float[np.ndarray, "frame 3"]:
        """Places of the radar in metres."""
        return self.poses[:, :3, 3]

    def describe(self) -> dict[str, Any]:
        """Return the sizes of both maps."""
        low, high = self.path.min(0), self.path.max(0)
        return {
            "frames": len(self.path),
            "path (m)": round(float(path_lengths(self.path)[-1]), 2),
            "extent of the path (m)": np.round(high - low, 2).tolist(),
            "voxel (m)": self.grid.voxel_m,
            "radar voxels": len(self.radar.voxels),
            "voxels": len(self.enhanced.voxels),
            "mean confidence (%)": round(100 * self.confidence, 1),
        }

    @property
    def confidence(self) -> float:
        """The share of the completed map's voxels that are expected to be right."""
        found = self.enhanced.probability
        return float(found.sum()) / max(len(found), 1)


def map_recording(
    recording: Recording,
    model: Model,
    *,
    frames: slice | range = slice(None),
    points: PointSpec = POINTS,
    rotation: str | None = None,
    loops: bool = False,
    advance: Callable[..., None] = lambda done, note="": None,
) -> RecordingMap:
    """Return the maps of a recording's frames; host.

    Points are the radar's own, or those that a detector with `points` finds. The
    recorded poses are used. Without them, poses follow from Doppler and `rotation`, by
    default the IMU's where there is one. With `loops`, the poses are made to agree
    where the radar comes back. Points that move are left out, and so are frames outside
    the poses. Raises UsageError for poses that jump, and if no point is left, and
    ImportError for `loops` without their extra.
    """
    if loops:
        check_libraries()
    chosen, found = chosen_frames(recording, frames), None
    poses, notes = radar_poses(recording, chosen, rotation=rotation)
    posed = np.flatnonzero(np.isfinite(poses).all((1, 2)))
    span = slice(posed[0], posed[-1] + 1)
    chosen, poses = chosen[span], poses[span]
    if recording.of_points:
        clouds = (recording.frames[frame].padded() for frame in chosen)
    else:
        found = detect_recording(recording, points=points, frames=chosen)
        clouds = (frame.points for frame in found)
    notes += [*_check_path(recording, chosen, poses[:, :3, 3])]
    elevation = recording.has_elevation
    if not elevation:
        notes.append("the radar measures one plane, so the map shows only that")
    moves = recording.of_points or recording.radar.spec.num_chirps > 1
    key = jax.random.key(0)

    def still(cloud: PointCloud) -> Points:
        """Return the points that do not move."""
        kept = np.asarray(cloud.valid)
        if moves and cloud.velocity is not None:
            motion = ego_velocity(key, cloud, elevation=elevation)
            kept = kept & ~np.asarray(motion.moving)
        return np.asarray(cloud.xyz)[kept]

    def said() -> Iterator[str]:
        """Yield the notes, once all frames are mapped."""
        yield from () if found is None else found.warnings
        yield from notes

    mapped = map_clouds(
        map(still, clouds), poses, model, notes=said(), loops=loops, advance=advance
    )
    stamps = None
    if recording.frames.stamps is not None:
        stamps = _middle(recording, chosen)[: len(mapped.poses)]
    return mapped._replace(stamps=stamps, base_from_radar=recording.base_from_radar)


def map_clouds(
    clouds: Iterable[Points],
    poses: Float[np.ndarray, "frame 4 4"],
    model: Model,
    *,
    notes: Iterable[str] = (),
    loops: bool = False,
    advance: Callable[..., None] = lambda done, note="": None,
) -> RecordingMap:
    """Return the maps of clouds, each in the frame of its sensor's pose; host.

    Ctrl-C ends the walk there: the maps are those of the clouds until then, and a note
    says so. With `loops`, all clouds are held until their poses are known. `advance` is
    called with the number of clouds so far and, while loops are closed, with a note.
    Raises UsageError where no point is within the sensor model's range.
    """
    grid = column_grid(model)
    voxels, done = VoxelMap(SensorModel(voxel_m=grid.voxel_m)), 0
    held = list[Points]()
    with first_interrupt_noted() as interrupted:
        for done, (xyz, pose) in enumerate(zip(clouds, poses, strict=True), 1):
            if loops:
                held.append(xyz)
            else:
                voxels.add(xyz, pose)
            advance(done)
            if interrupted:
                break
    notes, ended_early = [*notes], done < len(poses)
    if ended_early:
        notes.append(f"interrupted: the map shows {done} of {len(poses)} frames")
        poses = poses[:done]
    if loops:

        def share(done: float) -> None:
            advance(len(poses), f"closing loops, {100 * done:.0f} %")

        try:
            poses, note = _closed(held, poses, share)
        except KeyboardInterrupt:
            note, ended_early = "interrupted: the loops are not closed", True
        notes.append(note)
        for xyz, pose in zip(held, poses, strict=True):
            voxels.add(xyz, pose)
    occupied = likely_first(*voxels.occupied())
    if not len(occupied.voxels):
        raise UsageError(
            f"no points within {voxels.sensor.max_range_m:g} m in these frames, "
            "expected some to make a map of"
        )
    start = int(np.floor(poses[0, 2, 3] / grid.voxel_m))
    likely = enhance_map(occupied.voxels, model, start_height=start)
    enhanced = expected(likely)
    maps = grid, occupied, enhanced, voxels.free()
    return RecordingMap(*maps, poses, tuple(notes), ended_early)


def _closed(clouds, poses, advance):
    """Return poses in which loops are closed, and a note on them."""
    closed, loops = close_loops(clouds, poses, advance=advance)
    if not loops:
        return poses, "no loop was found: the poses stay as they are"
    moved = float(np.linalg.norm(closed[-1, :3, 3] - poses[-1, :3, 3]))
    return closed, f"{len(loops)} loops were closed: the end moves by {moved:.2g} m"


def radar_poses(
    recording: Recording, frames: Sequence[int], *, rotation: str | None = None
) -> tuple[Float[np.ndarray, "frame 4 4"], list[str]]:
    """Return the radar's poses in the world, and notes on where they come from.

    The recorded poses are used. Without them, or with `rotation`, poses follow from
    Doppler. Frames outside the recorded poses that it uses have NaN.
    """
    stamps, mount = recording.frames.stamps, recording.base_from_radar
    if recording.poses is not None and rotation is None and stamps is not None:
        notes = []
        if mount is None:
            mount = np.eye(4)
            notes.append("the radar's place on the base is unknown, and taken as 0")
        middle = _middle(recording, frames)
        notes += within_poses(recording.poses, middle)[1]
        return interpolate_poses(recording.poses, middle) @ mount, notes
    velocities = frame_velocities(recording, frames=frames)
    rotation = rotation or ("none" if recording.imu is None else "imu")
    found = odometry(recording, velocities, rotation=rotation)
    poses = np.full((len(frames), 4, 4), np.nan)
    poses[np.isin(velocities.stamps, found.stamps)] = found.world_from_radar
    return poses, [f"poses from Doppler and {rotation}", *found.notes]


def _middle(recording, frames):
    """Return the times of the middle of frames, in seconds."""
    return np.asarray(recording.frames.stamps)[list(frames)] + recording.frame_middle_s


def _check_path(recording, frames, path):
    """Yield notes on a path that jumps or shows little; UsageError if it jumps far."""
    stamps = recording.frames.stamps
    if stamps is not None and len(path) > 1:
        seconds = np.maximum(np.diff(np.asarray(stamps)[list(frames)]), 1e-3)
        velocity = np.diff(path, axis=0) / seconds[:, None]
        speed = np.linalg.norm(velocity, axis=1)
        worst = int(np.argmax(speed))
        if speed[worst] > FASTEST_MPS:
            raise UsageError(
                f"{recording.path}: the poses jump by "
                f"{speed[worst] * seconds[worst]:.1f} m in {seconds[worst]:.3g} s "
                f"after frame {frames[worst]}: correct them, or use --frames to map "
                "the frames before and after separately"
            )
        change = np.linalg.norm(np.diff(velocity, axis=0), axis=1)
        if len(change) and change.max() > JUMP_MPS:
            k = int(np.argmax(change))
            yield (
                f"the poses jump near frame {frames[k + 1]}, from {speed[k]:.1f} to "
                f"{speed[k + 1]:.1f} m/s, so walls may appear twice: use --frames to "
                "map the frames before and after separately"
            )
    if len(path) < FEWEST:
        yield f"{len(path)} frames make a thin map: use {FEWEST} or more"
    if np.ptp(path, axis=0).max() < SHORTEST_M:
        yield (
            "the radar hardly moved, so the map shows each surface from one side only: "
            "walk through the place"
        )


def map_files(found: RecordingMap) -> dict[str, Callable[[Path], None]]:
    """Return the function that writes each of FILES, by name."""
    text = json.dumps(found.describe() | {"notes": found.notes}, indent=2) + "\n"
    grid, corner = occupancy_grid(found)
    files: dict[str, Callable[[Path], None]] = {
        "map.ply": lambda path: _write_voxels(path, found.enhanced, found.grid),
        "radar_map.ply": lambda path: _write_voxels(path, found.radar, found.grid),
        "grid.pgm": lambda path: _write_pgm(path, grid),
        "grid.yaml": lambda path: write_text(path, _grid_yaml(found.grid, corner)),
        "map.json": lambda path: write_text(path, text),
        "map.png": lambda path: save_figure(_figure(found), path),
    }
    if found.stamps is not None:
        mount = np.eye(4) if found.base_from_radar is None else found.base_from_radar
        trajectory = Trajectory(found.stamps, found.poses, mount)
        files["trajectory.tum"] = lambda path: write_tum(path, trajectory)
    return files


def _figure(found):
    """Return the picture of both maps."""
    metres = found.grid.metres
    maps = {"radar": found.radar.voxels, "jradar": found.enhanced.voxels}
    return maps_figure(
        {k: metres(voxels) for k, voxels in maps.items()},
        path=found.path,
        title=f"{found.confidence:.0%} of jradar's voxels may be right",
    )


def occupancy_grid(
    found: RecordingMap,
) -> tuple[np.ndarray, Float[np.ndarray, " 2"]]:
    """Return a plan [y, x] of grey values from the top left, and its corner in metres.

    A cell is occupied where the map has a voxel near the height of the radar's path,
    and else free where the radar looked through it.
    """
    near = _near_path(found)
    occupied, free = near(found.enhanced.voxels), near(found.free)
    both = np.concatenate([occupied, free, _cells(found)])
    low, high = both.min(0), both.max(0)
    grid = np.full(high - low + 1, UNKNOWN, np.uint8)
    for cells, value in ((free, FREE), (occupied, OCCUPIED)):
        grid[tuple((cells - low).T)] = value
    return grid.T[::-1], low * found.grid.voxel_m


def _cells(found):
    """The columns of the path."""
    return np.floor(found.path[:, :2] / found.grid.voxel_m).astype(int)


def _near_path(found):
    """Return the function that finds the columns with voxels near the path's height."""
    from scipy.spatial import KDTree

    tree = KDTree(found.path[:, :2])

    def columns(voxels):
        if not len(voxels):
            return np.zeros((0, 2), int)
        xyz = found.grid.metres(voxels)
        height = xyz[:, 2] - found.path[tree.query(xyz[:, :2])[1], 2]
        kept = (height >= BAND_M[0]) & (height <= BAND_M[1])
        return np.unique(voxels[kept, :2], axis=0)

    return columns


def _write_voxels(path, occupied, spec):
    """Write the middles of voxels, with their probability as confidence."""
    xyz = spec.metres(occupied.voxels).astype(np.float32)
    confidence = occupied.probability.astype(np.float32)
    cloud = PointCloud(xyz, np.ones(len(xyz), bool), confidence=confidence)  # pyright: ignore[reportArgumentType]
    write_ply(path, cloud)


def _write_pgm(path, grid):
    """Write a grey picture."""
    header = f"P5\n{grid.shape[1]} {grid.shape[0]}\n255\n"
    with atomic_path(path) as scratch:
        scratch.write_bytes(header.encode() + np.ascontiguousarray(grid).tobytes())


def _grid_yaml(spec, corner):
    """Return the description that ROS's map_server reads."""
    return (
        "image: grid.pgm\n"
        f"resolution: {spec.voxel_m:g}\n"
        f"origin: [{corner[0]:.3f}, {corner[1]:.3f}, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
