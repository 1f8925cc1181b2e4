r"""Compare trajectories of KISS-ICP on radar, enhanced and LiDAR clouds; simulated.

    jradar simulate --scene lab --seed 950 --frames 80 -o sim
    python -m experiments.studies.slam sim/lab_950 -o runs/slam.md

KISS-ICP (Vizzo et al. 2023) has the same settings for all clouds: points from 0.5 to
15 m, voxels of 0.3 m, no deskewing, and its defaults otherwise. Enhanced clouds are
taken as they are, with their confident points alone, and with three frames fused.
`jradar odometry` is scored, too. APE and RPE are rms values, as evo defines them, of
the radar's places. `still` is the APE of a trajectory that never moves.
"""

import sys
from argparse import Namespace
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from experiments.command import run_study, study_parser
from experiments.evaluate import points_of
from jradar.evaluation import markdown_table
from jradar.files import write_text
from jradar.lidar import interpolate_poses
from jradar.model import Model, load_model
from jradar.motion import (
    frame_velocities,
    odometry,
    position_errors,
    step_errors,
)
from jradar.motion.velocities import POINTS
from jradar.progress import progress
from jradar.radar import radar_points
from jradar.recordings import (
    Recording,
    nearest_scan,
    open_recording,
)
from jradar.session import enhance_recording

SURE, FUSED = 0.5, 3  # confidence and number of frames of the rows that have them
VOXEL_M, NEAREST_M, FARTHEST_M = 0.3, 0.5, 15.0
LEAST_POINTS = 10  # of a cloud that is matched


def main(argv: list[str] | None = None) -> int:
    """Run the study and return the exit code."""
    parser = study_parser("slam", __doc__, output="the table, a Markdown file")
    parser.add_argument("recordings", nargs="+", help="with poses, LiDAR and IMU")
    parser.add_argument("--model", default="jradar-sim", help="shipped, or a folder")
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Write the table."""
    model, rows = load_model(options.model), []
    for path in options.recordings:
        rows += trajectory_rows(open_recording(Path(path)), model)
    text = markdown_table(
        ["recording", "path (m)", "trajectory", "APE (m)", "RPE (m)", "RPE (deg)"], rows
    )
    write_text(options.output, text)
    print(text)


def trajectory_rows(recording: Recording, model: Model) -> list[list[str]]:
    """Return the errors of each trajectory of a recording."""
    middle = np.asarray(recording.cubes.stamps) + recording.radar.spec.frame_middle_s
    true = interpolate_poses(recording.poses, middle) @ recording.base_from_radar
    velocities = frame_velocities(recording)
    found = {
        "KISS-ICP, OS-CFAR": kiss_icp_poses(detections(recording)),
        **{
            f"KISS-ICP, {name}": kiss_icp_poses(clouds)
            for name, clouds in enhanced(recording, model).items()
        },
        "KISS-ICP, LiDAR": kiss_icp_poses(scans(recording)),
    }
    for name, rotation in (("velocity and IMU", "imu"), ("velocity", "none")):
        trajectory = odometry(recording, velocities, rotation=rotation)
        found[f"`jradar odometry`, {name}"] = trajectory.world_from_radar
    found["still"] = np.tile(np.eye(4), (len(true), 1, 1))
    way = np.linalg.norm(np.diff(true[:, :3, 3], axis=0), axis=1).sum()
    rows = []
    for name, poses in found.items():
        metres, degrees = step_errors(poses, true)
        ape = position_errors(poses, true).rmse
        rows.append(
            [recording.name, f"{way:.1f}", name]
            + [f"{ape:.3f}", f"{metres.rmse:.3f}", f"{degrees.rmse:.2f}"]
        )
    return rows


def kiss_icp_poses(clouds: Iterable[np.ndarray]) -> np.ndarray:
    """Return the pose of each cloud, [cloud, 4, 4]; small clouds keep the last one."""
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP

    config = KISSConfig()
    config.data.min_range, config.data.max_range = NEAREST_M, FARTHEST_M
    config.data.deskew, config.mapping.voxel_size = False, VOXEL_M
    matcher, poses = KissICP(config), []
    for xyz in clouds:
        if len(xyz) >= LEAST_POINTS:
            matcher.register_frame(np.float64(xyz), np.zeros(0))
        poses.append(np.array(matcher.last_pose))
    return np.array(poses)


def detections(recording: Recording) -> Iterator[np.ndarray]:
    """Yield the OS-CFAR detections of each frame."""
    radar = recording.radar
    for frame in range(len(recording.cubes)):
        cube, points = recording.cube(frame), POINTS.fitted(radar.spec)
        yield points_of(radar_points(cube, radar, points=points))


def enhanced(recording: Recording, model: Model) -> dict[str, list[np.ndarray]]:
    """Return the dense clouds of all frames, by how they were made.

    Fused frames are laid together by the radar's velocity and the IMU, as `jradar
    enhance --fuse` does where there are no poses.
    """
    names = ("enhanced", f"confidence {SURE}", f"{FUSED} frames fused")
    found: dict[str, list[np.ndarray]] = {name: [] for name in names}
    with progress("enhancing", 2 * len(recording.cubes), unit="frames") as show:
        for frame in enhance_recording(recording, model):
            sure = np.asarray(frame.cloud.confidence) >= SURE
            found[names[0]].append(points_of(frame.cloud))
            found[names[1]].append(np.asarray(frame.cloud.xyz)[sure])
            show(len(found[names[1]]), recording.name)
        alone = recording._replace(poses=None)
        for frame in enhance_recording(alone, model, fuse=FUSED):
            found[names[2]].append(points_of(frame.cloud))
            show(len(recording.cubes) + len(found[names[2]]), recording.name)
    return found


def scans(recording: Recording) -> Iterator[np.ndarray]:
    """Yield the scan next to each frame, in the radar's frame; empty without one."""
    for frame in range(len(recording.cubes)):
        found = nearest_scan(recording, frame)
        yield np.zeros((0, 3)) if found is None else found


if __name__ == "__main__":
    sys.exit(main())
