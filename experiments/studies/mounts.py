r"""How well does a walk show where the radar sits on its rig?

    python -m experiments.studies.mounts -o runs/mounts

Ten rigs of a calibrated AWR1843 and a Livox Mid-360, whose mounts are described wrongly
by 4 degrees, walk for 30 s through ten kinds of places. `jradar calibrate --mount`
estimates each mount, by true poses and by those of KISS-ICP. Two more walks are
straight, and one of these is short. `mounts.md` has the errors of each axis and the
share within two stated deviations, of the axes that a walk shows. An interrupted study
resumes.
"""

import json
import sys
from argparse import Namespace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.command import run_study, study_parser
from jradar.calibration import calibrate_recording
from jradar.calibration.mount import AXES
from jradar.evaluation import markdown_table
from jradar.files import read_json, write_text
from jradar.recordings import open_recording
from jradar.simulation.capture_writer import simulate_capture
from jradar.simulation.rig import base_from
from jradar.simulation.units import FIRST_SHIFT, UnitSpec

PLACES = ("corridor", "hall", "lab", "home", "room", "atrium", "hallways", "plantroom",
          "outdoor", "carpark")  # fmt: skip
FIRST_SEED, FIRST_BOARD = 4000, FIRST_SHIFT + 100
FRAMES = 300  # of 0.1 s
STRAIGHT = {"straight, 15 s": slice(0, 150), "straight, 4 s": slice(0, 40)}  # corridor
KINDS = ("true poses", "KISS-ICP")


def main(argv: list[str] | None = None) -> int:
    """Run the study and return the exit code."""
    return run_study(study, study_parser("experiments.studies.mounts", __doc__), argv)


def study(options: Namespace) -> None:
    """Simulate and calibrate; write the table."""
    found = []
    for k, family in enumerate(PLACES):
        walk = options.output / "walks" / f"{family}_{FIRST_SEED + k}"
        if not walk.is_dir():
            simulate_capture(
                family, FIRST_SEED + k, walk.parent, frames=FRAMES, unit=_unit(k)
            )
        parts = {family: slice(None), **(STRAIGHT if family == "corridor" else {})}
        for name, frames in parts.items():
            for kind in KINDS:
                path = options.output / "found" / f"{name} {kind}.json"
                if not path.is_file():
                    result = _calibrated(walk, frames, kind)
                    write_text(path, json.dumps(result) + "\n")
                found.append({"walk": name, "poses": kind, **read_json(path)})
    report(options.output / "mounts.md", found)


def _unit(k: int) -> UnitSpec:
    return UnitSpec(
        board=FIRST_BOARD + k,
        channel_degrees=2.0,  # what a calibration leaves
        channel_db=0.2,
        mount_degrees=4.0,
        speed_mps=1.0,
    )


def _calibrated(walk: Path, frames: slice, kind: str) -> dict[str, Any]:
    """Return errors and stated deviations of the axes, or why there are none."""
    recording, true = open_recording(walk), base_from("single_chip")
    if kind != KINDS[0]:
        recording = recording._replace(poses=None)
    try:
        mount = calibrate_recording(recording, frames=frames, mount=True).mount
    except ValueError as error:
        return {"refused": str(error)}
    assert mount is not None
    turn = Rotation.from_matrix(true[:3, :3].T @ mount.base_from_radar[:3, :3])
    apart = mount.base_from_radar[:3, 3] - true[:3, 3]
    sizes = np.array([size for *_, size in AXES])
    # A simulated echo has the velocity of the start of its frame throughout.
    late = mount.offset_s + recording.radar.spec.frame_middle_s
    errors = np.r_[turn.as_rotvec(), apart, late]
    return {
        "error": (errors / sizes).tolist(),
        "deviation": (mount.deviation / sizes).tolist(),
        "shown": mount.observed.tolist(),
    }


def report(path: Path, found: list[dict[str, Any]]) -> None:
    """Write the table of the axes, that of the walks, and what was refused."""
    rows = []
    for kind in KINDS:
        kept = [f for f in found if f["poses"] == kind and "error" in f]
        kept = [f for f in kept if f["walk"] not in STRAIGHT]
        for axis, (name, unit, _) in enumerate(AXES):
            shown = [f for f in kept if f["shown"][axis]]
            errors = np.abs([f["error"][axis] for f in shown])
            stated = np.array([f["deviation"][axis] for f in shown])
            cells = ["", "", ""]
            if len(shown):
                cells = [f"{np.sqrt(np.mean(errors**2)):.3f}", f"{errors.max():.3f}"]
                cells += [f"{np.sum(errors <= 2 * stated)} of {len(shown)}"]
            rows.append([kind, f"{name} ({unit})", f"{len(shown)}/{len(kept)}", *cells])
    titles = ["poses", "axis", "shown", "error, rms", "largest", "within 2 deviations"]
    walks = [
        [f["walk"], f["poses"], f.get("refused") or _axes(f["shown"])] for f in found
    ]
    table = markdown_table(titles, rows)
    table += "\n" + markdown_table(["walk", "poses", "not shown"], walks)
    write_text(path, table)
    print(table)


def _axes(shown: list[bool]) -> str:
    return ", ".join(
        name for (name, *_), seen in zip(AXES, shown, strict=True) if not seen
    )


if __name__ == "__main__":
    sys.exit(main())
