r"""What do closed loops change? Maps of a simulated walk that comes back several times.

    jradar simulate --scene hallways --frames 3000 -o sim
    jradar calibrate sim/hallways_0 --level -o hallways.toml
    python -m experiments.studies.loops sim/hallways_0 --radar hallways.toml \
        -o runs/loops

Poses follow from Doppler and the IMU, and start at the true pose. A wall that is drawn
twice lies away from that of the true poses, so the table shows the share of the map's
voxels within 0.3 m of the latter. `loops.png` shows the radar's maps.
"""

import sys
from argparse import Namespace
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from experiments.command import run_study, study_parser
from jradar import load_model, open_recording
from jradar.errors import UsageError
from jradar.evaluation.tables import markdown_table
from jradar.files import write_text
from jradar.mapping import RecordingMap, map_recording, radar_poses
from jradar.options.recordings import ROTATIONS
from jradar.viz import maps_figure, save_figure

NEAR_M = 0.3  # of a wall that is drawn where it is
TITLES = (
    *("poses", "mean error (m)", "error at the end (m)", "voxels"),
    f"within {NEAR_M} m of the true map (%)",
)


def main(argv: list[str] | None = None) -> int:
    """Write a table and a picture, and return the exit code."""
    parser = study_parser("experiments.studies.loops", __doc__)
    parser.add_argument("recording", type=Path, help="a walk with poses")
    parser.add_argument("--radar", type=Path, help="its description, calibrated")
    parser.add_argument("--rotation", choices=ROTATIONS, default="imu")
    parser.add_argument("--frames", type=int, help="the first ones (default: all)")
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Map the walk by its poses, by odometry, and by odometry with closed loops."""
    recording = open_recording(options.recording, options.radar)
    if recording.poses is None:
        raise UsageError(f"{recording.path} has no poses, expected true ones")
    frames = range(len(recording.frames))[: options.frames]
    model, rotation = load_model("jradar-maps"), options.rotation
    true, drifting = (
        radar_poses(recording, frames, rotation=by)[0] for by in (None, rotation)
    )
    to_world = true[0] @ np.linalg.inv(drifting[0])
    found = {
        "true poses": map_recording(recording, model, frames=frames),
        "odometry": map_recording(recording, model, frames=frames, rotation=rotation),
        "loops closed": map_recording(
            recording, model, frames=frames, rotation=rotation, loops=True
        ),
    }
    worlds = (np.eye(4), to_world, to_world)
    placed = {
        name: _placed(each, world)
        for (name, each), world in zip(found.items(), worlds, strict=True)
    }
    path, walls = placed["true poses"]
    tree, rows = KDTree(walls), []
    for name, (places, voxels) in placed.items():
        away = np.linalg.norm(places - path, axis=1)
        right = f"{100 * np.mean(tree.query(voxels)[0] < NEAR_M):.1f}"
        errors = f"{away.mean():.2f}", f"{away[-1]:.2f}"
        rows.append((name, *errors, f"{len(voxels):,}", right))
    notes = "\n".join(found["loops closed"].notes)
    text = f"{markdown_table(TITLES, rows)}\n{notes}\n"
    write_text(options.output / "loops.md", text)
    figure = maps_figure({name: voxels for name, (_, voxels) in placed.items()})
    save_figure(figure, options.output / "loops.png")
    print(text)


def _placed(found: RecordingMap, world: np.ndarray):
    """Return the path and the radar's voxels in metres, in the true world."""
    places = found.path, found.grid.metres(found.radar.voxels)
    return [xyz @ world[:3, :3].T + world[:3, 3] for xyz in places]


if __name__ == "__main__":
    sys.exit(main())
