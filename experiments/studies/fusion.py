r"""Score a model on one frame, and on several frames that its motion holds together.

    python -m experiments.studies.fusion RECORDS RECORDINGS -o runs/fusion

RECORDS has consecutive frames of each sequence, and RECORDINGS the folder of each
sequence that they were prepared from. Every frame that has enough earlier ones is
scored with 1, 3 and 5 frames, so that all rows are of the same frames. The motion is
what `jradar enhance --fuse` takes: of the recorded poses, or of the radar's velocity
and the rotation of the IMU (`imu`), or of its velocity alone. Pixels that move by
themselves are left out of earlier frames, except in the rows `movers kept`.

`fusion.md` has the scores, the paired differences from one frame, and the time a frame
takes. Where the simulator knows what moves, a second table scores it
(`experiments.movers`).
"""

import sys
import time
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from experiments import movers
from experiments.build import build_pairs
from experiments.command import run_study, study_parser
from experiments.evaluate import points_of
from experiments.fusing import see
from experiments.tables import known_mean, markdown_table
from jradar import data, evaluation
from jradar.diffusion import RangeMixture
from jradar.errors import UsageError
from jradar.files import write_text
from jradar.lidar import transform
from jradar.metrics import compare_on_host
from jradar.model import Model, fuse, load_model
from jradar.motion import Follower
from jradar.progress import progress
from jradar.range_image import unproject
from jradar.recordings import open_recording
from jradar.simulation.scanner import OUSTER

COUNTS = (1, 3, 5)
MOTIONS = ("poses", "imu", "velocity")
SCORES = (  # title, key, scale, digits
    ("Chamfer (m)", "chamfer", 1, 3),
    ("MHD (m)", "hausdorff", 1, 3),
    ("F-score (%)", "f_score", 100, 1),
    ("points", "points", 1, 0),
    ("fusion (ms)", "milliseconds", 1, 0),
)
MOVERS = (
    ("recall (%)", "mover_recall", 100, 1),
    ("precision (%)", "mover_precision", 100, 1),
    ("F-score (%)", "mover_f", 100, 1),
    ("trailing points", "trail", 1, 0),
)


class Seen(NamedTuple):
    """What one frame tells."""

    frame: data.PreparedFrame
    mixture: RangeMixture
    moving: Bool[Array, "row column"]
    poses: dict[str, Float[np.ndarray, "frame 4 4"]]  # newest first, by motion
    movers: Float[np.ndarray, "point 3"]  # on moving bodies, in the world


def main(argv: list[str] | None = None) -> int:
    """Run the study and return the exit code."""
    parser = study_parser("fusion", __doc__)
    parser.add_argument("records", help="records with consecutive frames")
    parser.add_argument("recordings", help="folder of the records' recordings")
    parser.add_argument("--model", default="jradar-sim", help="shipped, or a folder")
    parser.add_argument("--split", default="test", help="split of the records")
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Fuse the frames of all sequences, and write the tables."""
    model = load_model(options.model)
    records = data.Records(options.records, options.split)
    sequences: dict[str, list[int]] = {}
    for i, (sequence, _) in enumerate(records.where):
        sequences.setdefault(sequence, []).append(i)
    longest = max(COUNTS)
    if not any(len(index) >= longest for index in sequences.values()):
        raise UsageError(
            f"{options.records} has no sequence of {longest} frames, expected one: "
            "prepare recordings with more frames"
        )
    pairs, rows, done = build_pairs(model.spec, records), [], 0
    with progress("fusing", len(records), unit="frames") as show:
        for sequence, index in sequences.items():
            follow = Following(Path(options.recordings, sequence), longest)
            seen: list[Seen] = []
            for i in index:
                newest = follow.see(records[i], pairs[i].condition, model)
                seen = [newest, *seen[: longest - 1]]
                if len(seen) == longest:
                    rows += [row | {"sequence": sequence} for row in _rows(seen, model)]
                done += 1
                show(done, sequence)
    write_text(options.output / "fusion.md", text := report(rows))
    print(text)


class Following:
    """The frames of one recording, seen one after another."""

    def __init__(self, folder: Path, frames: int):
        """`frames` is how many are fused at most."""
        recording = open_recording(folder)
        self._radar = recording.radar
        self._scene = movers.scene_of_recording(folder)
        without = recording._replace(poses=None)
        self._followers = {
            "poses": Follower(recording, frames=frames),
            "imu": Follower(without, frames=frames),
            "velocity": Follower(without._replace(imu=None), frames=frames),
        }

    def see(self, frame: data.PreparedFrame, condition: Any, model: Model) -> Seen:
        """Return what the next frame tells."""
        mixture, moving, velocity = see(frame.radar, condition, model, self._radar)
        velocity = np.asarray(velocity)
        poses = {k: f.step(frame.frame, velocity) for k, f in self._followers.items()}
        theirs = np.zeros((0, 3))
        if self._scene is not None:
            middle = frame.lidar_stamp + OUSTER.period_s / 2
            theirs = movers.surfaces(self._scene, middle)
        return Seen(frame, mixture, moving, poses, theirs)


def _rows(seen: Sequence[Seen], model: Model) -> list[dict[str, Any]]:
    """The scores of the newest frame, by number of frames and kind of motion."""
    rows = [_row("one frame", seen[:1], "poses", model)]
    for count in COUNTS[1:]:
        some = seen[:count]
        for motion in MOTIONS:
            rows.append(_row(f"{count} frames, {motion}", some, motion, model))
        name = f"{count} frames, poses, movers kept"
        rows.append(_row(name, some, "poses", model, keep=True))
    to_radar = np.linalg.inv(seen[0].frame.world_from_radar)
    now, *before = (transform(to_radar, s.movers) for s in seen)
    truth = np.asarray(seen[0].frame.lidar_xyz)
    return [
        {k: value for k, value in row.items() if k != "cloud"}
        | _scores(row["cloud"], truth)
        | movers.mover_scores(row["cloud"], truth, now, before)
        for row in rows
    ]


def _row(name: str, seen, motion: str, model: Model, *, keep=False) -> dict[str, Any]:
    """The fused cloud of some frames, and the time that it took."""
    frames = jax.tree.map(lambda *values: jnp.stack(values), *[s.mixture for s in seen])
    moving = jnp.stack([s.moving for s in seen])
    poses = jnp.asarray(seen[0].poses[motion][: len(seen)], jnp.float32)
    started = time.perf_counter()
    image = fuse(frames, poses, model.spec, moving=moving & (not keep))
    range_m = np.asarray(image.range_m)
    took = time.perf_counter() - started
    cloud = points_of(unproject(range_m, model.spec.fine))
    return {
        "method": name,
        "cloud": cloud,
        "milliseconds": 1e3 * took,
        "points": len(cloud),
    }


def _scores(cloud: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """Distances and F-score; NaN without a truth."""
    if not len(truth):
        return dict.fromkeys(("chamfer", "hausdorff", "f_score"), float("nan"))
    score = compare_on_host(cloud, truth)
    return {
        "chamfer": float(score.chamfer),
        "hausdorff": float(score.modified_hausdorff),
        "f_score": float(np.nan_to_num(score.f_score[1])),
    }


def report(rows: list[dict[str, Any]]) -> str:
    """Return the tables of scores and of differences from one frame."""
    methods = [*dict.fromkeys(row["method"] for row in rows)]
    by = {name: [row for row in rows if row["method"] == name] for name in methods}
    single, *others = by.values()
    text = f"{len(single)} frames\n\n" + _table(SCORES, by)
    text += "\n" + _changes(SCORES[:3], single, others)
    theirs = {
        name: [row for row in found if np.isfinite(row["trail"])]
        for name, found in by.items()
    }
    single, *others = theirs.values()
    if not single:
        return text
    sequences = len({row["sequence"] for row in single})
    text += f"\n{len(single)} frames of {sequences} sequences with movers\n\n"
    text += _table(MOVERS, theirs)
    return text + "\n" + _changes(MOVERS, single, others)


def _table(columns, by: dict[str, list[dict[str, Any]]]) -> str:
    """Return the means of columns, by method."""
    cells = [
        [name]
        + [
            f"{scale * known_mean(row[key] for row in rows):.{digits}f}"
            for _, key, scale, digits in columns
        ]
        for name, rows in by.items()
    ]
    return markdown_table(["method", *(title for title, *_ in columns)], cells)


def _changes(columns, single, others) -> str:
    """Return the paired differences from one frame, with their intervals."""
    cells = []
    for rows in others:
        cells.append([rows[0]["method"]])
        for _, key, scale, _ in columns:
            change = [
                scale * (a[key] - b[key]) for a, b in zip(rows, single, strict=True)
            ]
            cells[-1].append(_interval(change, [row["sequence"] for row in single]))
    titles = ["against one frame", *(title for title, *_ in columns)]
    return markdown_table(titles, cells)


def _interval(values: Sequence[float], sequences: Sequence[str]) -> str:
    """The mean with half of a 95 % interval; frames of a sequence are correlated."""
    groups: dict[str, list[float]] = {}
    for value, sequence in zip(values, sequences, strict=True):
        groups.setdefault(sequence, []).append(value)
    found = evaluation.mean_interval([np.array(group) for group in groups.values()])
    return f"{found.mean:+.2f} ± {(found.high - found.low) / 2:.2f}"


if __name__ == "__main__":
    sys.exit(main())
