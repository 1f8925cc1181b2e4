r"""Compare maps of walks with the map of their LiDAR: what serves a robot best.

    python -m experiments.studies.walk_maps walks/home_901 walks/hall_902 \
        -o runs/walk_maps

The walks are recordings of radar and LiDAR with poses. The truth is the map of the
scans' part in the radar's field of view, up to 10 m. Rows: all CFAR detections, their
log-odds, all points of a model of frames, their log-odds by confidence, and a model of
maps on the CFAR map. In the plane of the radar, columns of voxels near its height say
how much free space is closed, and how much of the walls is missed. `table.md` has the
mean over the walks; the maps of each walk are drawn.

With `--later N`, the maps are those of the frames before N, and the others are a later
walk. What 20 of its frames see together is placed in each map by the registration of
KISS-ICP, from a start 0.3 m and 5 degrees off: loud radar points, or the clouds of the
model of frames. `relocalised.md` has the median errors in metres along the ground, and
in height, which a radar's view holds less firmly.
"""

import itertools
import math
import sys
from argparse import Namespace
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from experiments.command import run_study, study_parser
from jradar.errors import UsageError, optional
from jradar.evaluation import markdown_table
from jradar.files import write_text
from jradar.lidar import shared_field_of_view
from jradar.mapping import (
    MapModel,
    SensorModel,
    VoxelMap,
    load_map_model,
    map_recording,
    radar_poses,
)
from jradar.mapping.recording import BAND_M
from jradar.metrics import f_score
from jradar.model import Model, load_model
from jradar.recordings import Recording, nearest_scan, open_recording
from jradar.session import enhance_recording
from jradar.viz import maps_figure, save_figure

SCORES = {
    "f_15": "F at 0.15 m (%)",
    "f_30": "F at 0.3 m (%)",
    "closed": "free space closed (%)",
    "missed": "walls missed (%)",
    "voxels": "voxels",
}
LOUD = 10.0  # SNR of a point that a frame is placed by
OFF_M, OFF_DEG = 0.3, 5.0  # of the start from the truth
REACH_M = 0.6  # between a point and the map's, in registration
SPAN = 20  # frames that are placed together
SPACING_M = 0.15  # of their points
TRUTH = "LiDAR"
NEAR_M = 0.3  # of a wall that is not missed
MAX_RANGE_M = 10.0
AZIMUTH, ELEVATION = ((-math.radians(deg), math.radians(deg)) for deg in (60, 20))

Voxels = np.ndarray  # whole numbers [voxel, 3]


class Scans(NamedTuple):
    """Parts of a later walk: their true poses, and points in the radar's frame."""

    poses: np.ndarray  # [part, 4, 4]
    points: Mapping[str, Sequence[np.ndarray]]  # of each part, by kind


def main(argv: list[str] | None = None) -> int:
    """Score the maps of walks and return the exit code."""
    parser = study_parser("experiments.studies.walk_maps", __doc__)
    parser.add_argument("walks", nargs="+", metavar="WALK", help="recording")
    parser.add_argument("--model", default="jradar-sim", help="model of frames")
    parser.add_argument("--maps", default="jradar-maps", help="model of maps")
    text = "first frame of the later walk (default: there is none)"
    parser.add_argument("--later", type=int, help=text)
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Score each walk, and write the table of means."""
    model, maps = load_model(options.model), load_map_model(options.maps)
    rows, placed, text = [], [], ""
    for path in options.walks:
        recording = open_recording(path)
        count = len(recording.cubes)
        end = count if options.later is None else options.later
        if options.later is not None and not 0 < end <= count - SPAN:
            raise UsageError(
                f"--later {end}: {path} has {count} frames, expected a number above 0 "
                f"that leaves {SPAN} frames or more"
            )
        truth, free, path_m = lidar_map(recording, maps.spec.voxel_m, range(end))
        found = maps_of(recording, model, maps, range(end))
        for method, voxels in found.items():
            row = scores(voxels, truth, free, path_m, maps.spec.voxel_m)
            rows.append({"walk": recording.name, "method": method, **row})
        known = {
            name: maps.spec.metres(voxels)
            for name, voxels in ({**found, TRUTH: truth}).items()
            if len(voxels)
        }
        save_figure(
            maps_figure(known, path=path_m), options.output / f"{recording.name}.png"
        )
        write_text(options.output / "table.md", table(rows, SCORES))
        if end < count:
            scans = later_scans(recording, model, range(end, count))
            errors = {name: relocalised(xyz, scans) for name, xyz in known.items()}
            walk = {"walk": recording.name}
            placed += [{"method": name} | walk | row for name, row in errors.items()]
            columns = {name: f"{name} (m)" for name in errors[TRUTH]}
            text = table(placed, columns, digits=2)
            write_text(options.output / "relocalised.md", text)
    print(table(rows, SCORES), text, sep="\n")


def lidar_map(
    recording: Recording, voxel_m: float, frames: range
) -> tuple[Voxels, Voxels, np.ndarray]:
    """Return the LiDAR's occupied and free voxels, and the radar's path in metres."""
    poses, _ = radar_poses(recording, frames)
    found = VoxelMap(SensorModel(voxel_m=voxel_m, max_range_m=MAX_RANGE_M))
    for frame, pose in zip(frames, poses, strict=True):
        scan = nearest_scan(recording, frame)
        if scan is None:
            continue
        seen = shared_field_of_view(
            scan, azimuth=AZIMUTH, elevation=ELEVATION, max_range_m=MAX_RANGE_M
        )
        found.add(scan[seen], pose)
    truth = found.occupied()[0]
    if not len(truth):
        raise UsageError(
            f"{recording.path}: no LiDAR scan shows anything within {MAX_RANGE_M:g} m "
            "of the radar, expected one near the time of most frames"
        )
    return truth, found.free(), poses[:, :3, 3]


def maps_of(
    recording: Recording, model: Model, maps: MapModel, frames: range
) -> dict[str, Voxels]:
    """Return the occupied voxels of each row of the table."""
    voxel_m = maps.spec.voxel_m
    completed = map_recording(recording, maps, frames=frames)
    poses, _ = radar_poses(recording, frames)
    likely = VoxelMap(SensorModel(voxel_m=voxel_m, max_range_m=MAX_RANGE_M))
    every: dict[str, list[Voxels]] = {"CFAR": [], "frames": []}
    clouds = enhance_recording(recording, model, frames=frames)
    for frame, pose in zip(clouds, poses, strict=True):
        for name, cloud in (("CFAR", frame.points), ("frames", frame.cloud)):
            xyz = np.asarray(cloud.xyz)[np.asarray(cloud.valid)]
            xyz = xyz[np.linalg.norm(xyz, axis=1) <= MAX_RANGE_M]
            world = xyz @ pose[:3, :3].T + pose[:3, 3]
            every[name].append(np.floor(world / voxel_m).astype(int))
        cloud, confidence = frame.cloud, frame.cloud.confidence
        if confidence is not None:
            kept = np.asarray(cloud.valid)
            xyz, share = np.asarray(cloud.xyz)[kept], np.asarray(confidence)[kept]
            likely.add(xyz, pose, probability=share)
    joined = {k: np.unique(np.concatenate(parts), axis=0) for k, parts in every.items()}
    return {
        "CFAR, all detections": joined["CFAR"],
        "CFAR, log-odds": completed.radar.voxels,
        "model of frames, all points": joined["frames"],
        "model of frames, log-odds of confidence": likely.occupied()[0],
        "model of maps": completed.enhanced.voxels,
    }


def scores(
    voxels: Voxels, truth: Voxels, free: Voxels, path_m: np.ndarray, voxel_m: float
) -> dict[str, Any]:
    """Return the scores of a map; see `SCORES`. All lengths in metres."""
    points, right = ((some + 0.5) * voxel_m for some in (voxels, truth))
    tree = KDTree(path_m[:, :2])

    def plan(some):
        """The columns of voxels near the height of the path."""
        xyz = (some + 0.5) * voxel_m
        height = xyz[:, 2] - path_m[tree.query(xyz[:, :2])[1], 2]
        kept = (height >= BAND_M[0]) & (height <= BAND_M[1])
        return np.unique(some[kept, :2], axis=0)

    drawn, walls, open_ = plan(voxels), plan(truth), plan(free)
    open_ = _without(open_, walls)
    closed = len(open_) - len(_without(open_, drawn))
    away = KDTree(drawn).query(walls)[0] if len(drawn) else np.full(len(walls), np.inf)
    return {
        "f_15": 100 * f_score(points, right, within_m=0.15),
        "f_30": 100 * f_score(points, right, within_m=0.3),
        "closed": 100 * closed / max(len(open_), 1),
        "missed": 100 * float(np.mean(away * voxel_m > NEAR_M)) if len(walls) else 0.0,
        "voxels": len(voxels),
    }


def later_scans(recording: Recording, model: Model, frames: range) -> Scans:
    """Return what a later walk saw within each SPAN frames, from where it ended."""
    poses, _ = radar_poses(recording, frames)
    seen: dict[str, list[np.ndarray]] = {"radar points": [], "model's cloud": []}
    clouds = enhance_recording(recording, model, frames=frames)
    for frame, pose in zip(clouds, poses, strict=True):
        loud = frame.points.valid & (frame.points.snr >= LOUD)
        for name, cloud, valid in (
            ("radar points", frame.points, loud),
            ("model's cloud", frame.cloud, frame.cloud.valid),
        ):
            xyz = np.asarray(cloud.xyz, float)[np.asarray(valid)]
            seen[name].append(xyz @ pose[:3, :3].T + pose[:3, 3])
    ends = range(SPAN - 1, len(frames), SPAN // 2)
    points: dict[str, list[np.ndarray]] = {name: [] for name in seen}
    for name, end in itertools.product(seen, ends):
        world = np.concatenate(seen[name][end + 1 - SPAN : end + 1])
        cells = np.unique(np.floor(world / SPACING_M), axis=0, return_index=True)[1]
        points[name].append((world[cells] - poses[end, :3, 3]) @ poses[end, :3, :3])
    return Scans(poses[list(ends)], points)


def relocalised(known: np.ndarray, scans: Scans) -> dict[str, float]:
    """Return the median errors in metres with which scans of each kind are placed.

    `known` are the points of a map. A scan without points stays where it started.
    """
    options = {"need": "placing frames in a map needs kiss-icp", "extra": "odometry"}
    mapping = optional("kiss_icp.mapping", **options)
    place = mapping.VoxelHashMap(REACH_M, max_distance=1e6, max_points_per_voxel=64)
    place.add_points(known)
    register = optional("kiss_icp.registration", **options).Registration(
        max_num_iterations=50, convergence_criterion=1e-4
    )
    random = np.random.default_rng(0)
    starts = []
    for pose in scans.poses:
        ahead = random.normal(size=3)
        start = np.array(pose)
        start[:3, 3] += OFF_M * ahead / np.linalg.norm(ahead)
        side = random.choice([-1, 1])
        rotation = Rotation.from_euler("z", side * OFF_DEG, degrees=True)
        start[:3, :3] = rotation.as_matrix() @ start[:3, :3]
        starts.append(start)
    errors: dict[str, float] = {}
    for kind, clouds in scans.points.items():
        found = [
            register.align_points_to_map(xyz, place, start, REACH_M, REACH_M / 3)
            if len(xyz)
            else start
            for xyz, start in zip(clouds, starts, strict=True)
        ]
        off = np.array(found)[:, :3, 3] - scans.poses[:, :3, 3]
        errors[kind] = float(np.median(np.linalg.norm(off[:, :2], axis=1)))
        errors[f"{kind}: height"] = float(np.median(np.abs(off[:, 2])))
    return errors


def table(
    rows: list[dict[str, Any]], columns: Mapping[str, str], *, digits: int = 1
) -> str:
    """Return the means over walks in Markdown; `columns` are the titles of scores."""
    methods = dict.fromkeys(row["method"] for row in rows)

    def text(mean):
        return f"{mean:,.{0 if mean >= 1000 else digits}f}"

    return markdown_table(
        ["map", "walks", *columns.values()],
        [
            [method, len(some)]
            + [text(np.mean([row[name] for row in some])) for name in columns]
            for method in methods
            if (some := [row for row in rows if row["method"] == method])
        ],
    )


def _without(cells, others):
    """The rows of whole numbers that are not among others."""
    left = {*map(tuple, cells.tolist())} - {*map(tuple, others.tolist())}
    return np.array(sorted(left), int).reshape(-1, cells.shape[1])


if __name__ == "__main__":
    sys.exit(main())
