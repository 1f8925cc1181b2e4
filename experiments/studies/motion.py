r"""Measure ego velocity and odometry on simulated walks, against the truth.

    python -m experiments.studies.motion -o motion.md --scene lab 900

Simulates each scene, estimates the radar's velocity in each frame, and compares it with
the simulator's own; then integrates it with each source of orientation.
"""

import sys
import tempfile
from argparse import Namespace

import numpy as np

from experiments.command import run_study, study_parser
from jradar.files import atomic_path
from jradar.lidar import interpolate_poses
from jradar.motion import (
    ROTATIONS,
    Velocities,
    frame_velocities,
    odometry,
    position_errors,
    step_errors,
)
from jradar.recordings import open_recording
from jradar.simulation import make_setting, simulate_sequence
from jradar.simulation.rig import viewpoint
from jradar.simulation.sequence import EPOCH_S

HEADS = (
    "| scene | speed (m/s) | inliers (%) | forward (m/s) | left (m/s) | up (m/s) |",
    "| scene | way (m) | rotation | APE (m) | APE / way (%) | RPE (m) | RPE (deg) |",
)


def main(argv: list[str] | None = None) -> int:
    """Run the study and return the exit code."""
    parser = study_parser("motion", __doc__, output="the tables, a Markdown file")
    parser.add_argument(
        "--scene",
        action="append",
        nargs=2,
        metavar=("FAMILY", "SEED"),
        help="family and seed of a scene; may be repeated (default: lab 900)",
    )
    text = "frames of each scene, 10 a second (default 20)"
    parser.add_argument("--frames", type=int, default=20, help=text)
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Write both tables."""
    velocity_rows, way_rows = [], []
    for family, seed in options.scene or [("lab", "900")]:
        with tempfile.TemporaryDirectory() as folder:
            path = simulate_sequence(family, int(seed), folder, frames=options.frames)
            recording = open_recording(path)
            found = frame_velocities(recording)
            true = true_velocities(family, int(seed), found.stamps)
            velocity_rows.append(velocity_row(recording.name, found, true))
            way_rows += way_row(recording, found)
    lines = [
        *table(HEADS[0], velocity_rows),
        "",
        *table(HEADS[1], way_rows),
    ]
    with atomic_path(options.output) as scratch:
        scratch.write_text("\n".join(lines) + "\n")
    print("\n".join(lines))


def true_velocities(family: str, seed: int, stamps: np.ndarray) -> np.ndarray:
    """Return the radar's true velocities along its axes, [frame, 3]."""
    platform = make_setting(family, seed).scene.platform
    views = [viewpoint(platform, "single_chip", t) for t in stamps - EPOCH_S]
    return np.array([view.turn.T @ view.velocity for view in views])


def velocity_row(name: str, found: Velocities, true: np.ndarray) -> str:
    """Return the rms of the errors, with their means in brackets."""
    error = found.velocity - true
    known = np.isfinite(error).all(1)
    rms, mean = np.sqrt((error[known] ** 2).mean(0)), error[known].mean(0)
    cells = [f"{r:.3f} ({m:+.3f})" for r, m in zip(rms, mean, strict=True)]
    share = 100 * np.mean(found.inliers / np.maximum(found.points, 1))
    speed = np.linalg.norm(true, axis=1).mean()
    return f"| {name} | {speed:.2f} | {share:.0f} | {' | '.join(cells)} |"


def way_row(recording, found: Velocities) -> list[str]:
    """Return APE and RPE with each source of orientation."""
    true = interpolate_poses(recording.poses, found.stamps)
    way = np.linalg.norm(np.diff(true[:, :3, 3], axis=0), axis=1).sum()
    rows = []
    for rotation in ROTATIONS:
        trajectory = odometry(recording, found, rotation=rotation)
        ape = position_errors(trajectory.world_from_base, true).rmse
        metres, degrees = step_errors(trajectory.world_from_base, true)
        rows.append(
            f"| {recording.name} | {way:.2f} | {rotation} | {ape:.3f} | "
            f"{100 * ape / way:.1f} | {metres.rmse:.3f} | {degrees.rmse:.2f} |"
        )
    return rows


def table(head: str, rows: list[str]) -> list[str]:
    """Return the lines of a Markdown table."""
    return [head, "|---" * (head.count("|") - 1) + "|", *rows]


if __name__ == "__main__":
    sys.exit(main())
