"""Map single frames of DREAM-PCD, another real radar, with a model of maps.

    python -m experiments.studies.dream_pcd 2023_05_18.npz -o runs/dream_pcd

The file holds `points` [n, 10], which begin with world coordinates, the `frame` [n] of
each point, `frame_ids` [frame], and `world_from_radar` [frame, 4, 4]. Its axes are
right, forward and up. Nothing was trained on this radar.
"""

import sys
from argparse import Namespace
from pathlib import Path

import numpy as np

from experiments.command import run_study, study_parser
from jradar.errors import parsing
from jradar.mapping import load_map_model, map_clouds, map_files

AHEAD = np.array([[0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def main(argv: list[str] | None = None) -> int:
    """Write the maps and return the exit code."""
    parser = study_parser("experiments.studies.dream_pcd", __doc__)
    parser.add_argument("path", type=Path, help="frames and poses of a sequence")
    parser.add_argument("--model", default="jradar-maps", help="shipped, or a folder")
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Write the maps of a sequence."""
    clouds, poses = read_frames(options.path)
    found = map_clouds(clouds, poses, load_map_model(options.model))
    options.output.mkdir(parents=True, exist_ok=True)
    for name, write in map_files(found).items():
        write(options.output / name)
    for name, value in found.describe().items():
        print(f"{name}: {value}")


def read_frames(path: Path) -> tuple[list[np.ndarray], np.ndarray]:
    """Return clouds in the radar's frame, x forward and y left, and its poses.

    Raises ValueError for a file without these arrays.
    """
    with parsing(path, "a file with points, frame, frame_ids and world_from_radar"):
        with np.load(path, allow_pickle=False) as file:
            xyz, frame = file["points"][:, :3], file["frame"]
            ids, poses = file["frame_ids"], AHEAD @ file["world_from_radar"] @ AHEAD.T
        if not len(ids) == len(poses) or len(xyz) != len(frame):
            raise ValueError(f"{len(ids)} frames, {len(poses)} poses")
    world = xyz @ AHEAD[:3, :3].T
    return [
        (world[frame == number] - pose[:3, 3]) @ pose[:3, :3]
        for number, pose in zip(ids, poses, strict=True)
    ], poses


if __name__ == "__main__":
    sys.exit(main())
