r"""Do range images complete real radar maps? Views of ColoRadar's maps, as records.

    python -m experiments.studies.map_views --maps ColoRadar -o runs/views
    python -m experiments.main --config=experiments/configs/marginal.py \
        --config.data.path=runs/views --config.evaluation.detectors="()" \
        --config.evaluation.every=1 --workdir=runs/views_marginal

A view stands near a place of the robot, level, looking anywhere. Its radar points are
voxels of the radar's map in view, its LiDAR points the first voxels of the LiDAR's map
along rays. Radar voxels carry no power, so all have the same. Views of the runs that
validate and test in `jradar-sim-5` do so here, and `data.without` leaves an environment
out. Views are in no order. The same command resumes after its last complete run.

The study's question is closed. It stays because its views are real pairs of radar and
LiDAR in three dimensions, to train on.
"""

import dataclasses
import itertools
import json
import sys
from argparse import Namespace
from collections.abc import Iterator

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from experiments import build
from experiments.command import run_study, study_parser
from experiments.configs import marginal
from jradar import __version__
from jradar.data import PreparedFrame
from jradar.data.records import FORMAT, finished_shard, write_shard
from jradar.errors import UsageError
from jradar.files import write_text
from jradar.lidar import shared_field_of_view
from jradar.progress import progress
from jradar.radar import Cells
from jradar.range_image import ImageSpec, pixel_directions
from jradar.recordings.coloradar.maps import VOXEL_M, MapRun, open_runs
from jradar.simulation import draw_unit
from jradar.simulation.drawn import NEVER, RUNS, floor_height
from jradar.types import PointCloud

CONFIG = marginal.get_config()
CAPACITY = CONFIG.points.capacity
RAYS = (64, 256)  # rows and columns of the LiDAR in a view
SEEN = build.field_of_view(CONFIG.image)
VIEW = ImageSpec(*RAYS, **SEEN)
MOVED_M, EYE_M = 1.0, (0.5, 1.5)  # from a place of the robot; above its floor
FREE_M = 0.3  # around a view, without a LiDAR voxel
LEAST_HITS, LEAST_POINTS = 0.3, 32  # share of rays; radar voxels
VIEWS = 4  # of a place
TRIES = 8  # times as many places as the run has
POWER = 1e3  # of each voxel, and its SNR: those of an echo that stands out
FEW = 48  # views of each run that validates or tests
THIN = 40, CAPACITY  # points of a thin view


def main(argv: list[str] | None = None) -> int:
    """Write the records and return the exit code."""
    parser = study_parser("experiments.studies.map_views", __doc__)
    parser.add_argument("--maps", required=True, help="ColoRadar's maps, a folder")
    parser.add_argument("--views", type=int, default=10_000, help="that train")
    text = "keep as few points as one or some frames of a radar hold"
    parser.add_argument("--thin", action="store_true", help=text)
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Write a shard after the other, then the manifest."""
    if (options.output / "manifest.json").exists():
        raise UsageError(f"{options.output} has records already: choose another -o")
    runs = [run for run in open_runs(options.maps) if not run.name.endswith(NEVER)]
    split = {run.name: _split(run.name) for run in runs}
    training = [*split.values()].count("train")
    if not training or options.views < 1:
        raise UsageError(
            f"--views {options.views} of {training} runs in {options.maps} that train, "
            "expected one or more of both"
        )
    share = -(-options.views // training)
    sequences = []
    with progress("runs", len(runs)) as show:
        for number, run in enumerate(runs):
            name = f"{run.environment}_{number:05d}"
            count = share if split[run.name] == "train" else FEW
            about = {"sequence": name, "views": count, "thin": options.thin}
            path = options.output / name / "0000.array_record"
            if (shard := finished_shard(path, about)) is None:
                found = views(run, name, thin=options.thin)
                frames = itertools.islice(found, count)
                shard = write_shard(path, frames, about, {})
            sequences.append({
                "name": name,
                "split": split[run.name],
                "frames": len(shard["frames"]),
                "dropped": {},
                "notes": [f"views of {run.name}"],
                "shards": [shard],
            })  # fmt: skip
            show(number + 1, run.name)
    write_text(
        options.output / "manifest.json",
        json.dumps(_manifest(sequences), indent=1) + "\n",
    )


def views(run: MapRun, name: str, *, thin: bool = False) -> Iterator[PreparedFrame]:
    """Yield views of a run's maps, seeded by the name.

    A thin view has at most THIN points, a number drawn anew. Ends after TRIES times as
    many places as the run has patches.
    """
    random = np.random.default_rng([*name.encode()])
    radar, lidar = ((voxels + 0.5) * VOXEL_M for voxels in (run.radar, run.lidar))
    boxes = trimesh.voxel.ops.multibox(lidar, pitch=VOXEL_M)
    numbers = itertools.count()
    for _ in range(TRIES * len(run.radar_in_patch)):
        place = run.place(int(random.integers(len(run.radar_in_patch))))
        place += random.uniform(-MOVED_M, MOVED_M, 2)
        near = np.linalg.norm(lidar[:, :2] - place, axis=1) < 2.5
        if not near.any():
            continue
        origin = np.array(
            [*place, floor_height(lidar[near, 2]) + random.uniform(*EYE_M)]
        )
        if (np.linalg.norm(lidar[near] - origin, axis=1) < FREE_M).any():
            continue
        for yaw in random.uniform(-np.pi, np.pi, VIEWS):
            turn = Rotation.from_euler("z", yaw).as_matrix()
            local = (radar - origin) @ turn
            seen = local[shared_field_of_view(local, **SEEN)]
            hits = _first_hits(boxes, origin, turn)
            if len(seen) < LEAST_POINTS or len(hits) < LEAST_HITS * np.prod(RAYS):
                continue
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = turn, origin
            number = next(numbers)
            yield PreparedFrame(
                sequence=name,
                frame=number,
                stamp=float(number),
                lidar_stamp=float(number),
                world_from_radar=pose,
                cells=Cells(*np.zeros((3, 1, 1), np.float32)),
                radar=_cloud(random, seen, thin),
                lidar_xyz=hits.astype(np.float32),
            )


def _first_hits(boxes, origin, turn):
    """Return where rays meet the first voxels, in the frame of the view."""
    rays = pixel_directions(VIEW).reshape(-1, 3) @ turn.T
    starts = np.broadcast_to(origin, rays.shape)
    places, *_ = boxes.ray.intersects_location(starts, rays, multiple_hits=False)
    local = (places - origin) @ turn
    return local[np.linalg.norm(local, axis=1) < VIEW.max_range_m]


def _cloud(random, xyz, thin) -> PointCloud:
    """Return at most CAPACITY of the points, drawn at random, padded."""
    most = round(np.exp(random.uniform(*np.log(THIN)))) if thin else CAPACITY
    xyz = random.permutation(xyz)[:most]
    valid = np.arange(CAPACITY) < len(xyz)
    padded = np.zeros((CAPACITY, 3), np.float32)
    padded[valid] = xyz
    power = np.where(valid, POWER, 0).astype(np.float32)
    return PointCloud(padded, valid, np.zeros_like(power), power, power)


def _split(name):
    return next((split for split, names in RUNS.items() if name in names), "train")


def _manifest(sequences):
    return {
        "format": FORMAT,
        "jradar": __version__,
        "complete": True,
        "radar": dataclasses.asdict(draw_unit(0).radar()),
        "options": dataclasses.asdict(build.prepare_spec(CONFIG)),
        "frames": [None, None],
        "names": [sequence["name"] for sequence in sequences],
        "sequences": sequences,
    }


if __name__ == "__main__":
    sys.exit(main())
