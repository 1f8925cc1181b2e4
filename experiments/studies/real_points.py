r"""What are models worth on the points that a real radar sends, without a LiDAR?

    python -m experiments.studies.real_points walk.npz -o runs/real_points

A moving radar sees each surface in many frames. What at least two other frames saw of
the view of one, in voxels of 0.15 m, is its truth: a ghost that a frame sees alone is
not. So walks with poses show how much of the present a cloud has right. Frames whose
points are in the cloud are not asked. Rows are the radar's own points, `splat`, which
smears them, and the models, each with the points of the last seconds. clouds.png shows
the frame in the middle with the points of ten, and F-scores within 0.2 m.
"""

import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence

import jax
import numpy as np
from jaxtyping import Float

from experiments.command import run_study, study_parser
from jradar import load_model, open_recording
from jradar.errors import UsageError
from jradar.evaluation import (
    in_view,
    points_of,
    score_points,
    smeared,
    write_scores,
    write_tables,
)
from jradar.lidar import interpolate_poses
from jradar.pipeline import enhance_recording, frame_times
from jradar.progress import progress
from jradar.range_image import ImageSpec
from jradar.recordings import Recording
from jradar.viz import save_figure
from jradar.viz.results import clouds_figure

VOXEL_M, LEAST = 0.15, 2  # frames that must have hit a voxel
FRAMES = (1, 5, 10)  # joined
LEAST_TRUTH = 20  # voxels in view, fewer are not scored


def main(argv: list[str] | None = None) -> int:
    """Write scores and tables, and return the exit code."""
    parser = study_parser("experiments.studies.real_points", __doc__)
    parser.add_argument("path", help="a recording of points with poses")
    parser.add_argument("--model", action="append", default=[], help="repeatable")
    parser.add_argument("--every", type=int, default=1, help="frames between scores")
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Score each model with each number of frames."""
    recording = open_recording(options.path)
    voxels = hits(recording)
    rows, drawn = [], {}
    names = options.model or ["jradar-sim"]
    for name in names:
        for count in FRAMES:
            found = scores(recording, voxels, name, count, drawn, every=options.every)
            rows += (r for r in found if name == names[0] or r["method"] == name)
    write_scores(options.output / "frames.jsonl", rows)
    write_tables(options.output / "frames.jsonl")
    if drawn:
        figure = clouds_figure({f"{FRAMES[-1]} frames": drawn})
        save_figure(figure, options.output / "clouds.png")


def hits(recording: Recording) -> Float[np.ndarray, "hit 4"]:
    """Return the voxels that each frame hit, in the world, and the frame's number.

    Raises UsageError for a recording without poses or points.
    """
    times = frame_times(recording)
    if recording.poses is None or not recording.of_points or times is None:
        raise UsageError(f"{recording.path}: expected a radar's points, and poses")
    poses = _poses(recording, times)
    found = []
    for frame, pose in enumerate(poses):
        xyz = points_of(recording.frames[frame]) @ pose[:3, :3].T + pose[:3, 3]
        cells = np.unique(np.floor(xyz / VOXEL_M), axis=0)
        found.append(np.column_stack([cells, np.full(len(cells), frame)]))
    return np.concatenate(found)


def scores(
    recording: Recording,
    voxels: Float[np.ndarray, "hit 4"],
    name: str,
    count: int,
    drawn: dict[str, Float[np.ndarray, "point 3"]],
    *,
    every: int,
) -> Iterator[dict]:
    """Yield a row for each frame and method, with the points of `count` frames.

    `drawn` gets the clouds of the frame that is shown.
    """
    model, times = load_model(name), frame_times(recording)
    assert times is not None  # `hits` has made sure
    poses, view = _poses(recording, times), model.spec.frame_grid.view
    step_s = float(np.median(np.diff(times)))
    history = {"history_s": (count - 0.5) * step_s} if count > 1 else {}
    found = enhance_recording(recording, model, **history)
    title = f"{count} frame{'s' if count > 1 else ''}"
    shown = len(recording.frames) // 2 // every * every
    with progress(f"{name}, {title}", len(found.frames), unit="frames") as show:
        for frame in found:
            show(frame.number + 1)
            truth = _truth(voxels, poses, frame.number, count, view)
            if frame.number % every or len(truth) < LEAST_TRUTH:
                continue
            key = jax.random.fold_in(jax.random.key(0), frame.number)
            own = points_of(frame.points)
            clouds = {
                "radar points": own[in_view(own, view)],
                "splat": points_of(smeared(key, frame.points, view)),
                name: points_of(frame.cloud),
            }
            for method, xyz in clouds.items():
                scored = score_points(xyz, truth)
                if frame.number == shown and count == FRAMES[-1]:
                    drawn[f"{method}: {scored['f_score_0.2']:.0%}"] = xyz
                    drawn["other frames"] = drawn.pop("other frames", truth)  # last
                yield {
                    "scene": title,
                    "sequence": recording.name,
                    "frame": frame.number,
                    "truth": "other frames",
                    "method": method,
                    "points": len(xyz),
                    "truth_points": len(truth),
                    "milliseconds": float("nan"),
                    **scored,
                }


def _truth(voxels, poses, frame, count, view: ImageSpec):
    """Return the middles of voxels in view that other frames saw, along its axes."""
    joined = (voxels[:, 3] > frame - count) & (voxels[:, 3] <= frame)
    cells, times = np.unique(voxels[~joined, :3], axis=0, return_counts=True)
    world = (cells[times >= LEAST] + 0.5) * VOXEL_M
    pose = poses[frame]
    xyz = (world - pose[:3, 3]) @ pose[:3, :3]
    return xyz[in_view(xyz, view)]


def _poses(recording: Recording, times: Sequence[float]):
    """Return the radar's poses in the world."""
    assert recording.poses is not None
    mount = recording.base_from_radar
    base = interpolate_poses(recording.poses, np.asarray(times))
    return base if mount is None else base @ mount


if __name__ == "__main__":
    sys.exit(main())
