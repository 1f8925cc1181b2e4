r"""Score a model on one frame, and on several frames that its motion holds together.

    python -m experiments.studies.fusion RECORDS -o runs/fusion --model jradar-sim

RECORDS has consecutive frames of each sequence, with poses. Every frame that has enough
earlier ones is scored with 1, 3 and 5 frames, so that all rows are of the same frames.
The motion is that of the poses, or what the radar measures alone: the velocity of each
frame, without rotation. Echoes that do not fit the radar's velocity are left out of
earlier frames.

`fusion.md` has the scores, the paired differences from one frame, and the time a frame
takes. `near movers` is the share of LiDAR points within 0.5 m of an echo that moves by
itself which have a point of the cloud within 0.2 m.
"""

import sys
import time
from argparse import Namespace
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.spatial import KDTree

from experiments.build import build_pairs
from experiments.command import run_study, study_parser
from experiments.evaluate import points_of
from experiments.tables import known_mean, markdown_table
from jradar import data, evaluation
from jradar.diffusion import RangeMixture
from jradar.errors import UsageError
from jradar.files import write_text
from jradar.metrics import compare_on_host
from jradar.model import Model, fuse, load_model, mixtures, moving_pixels
from jradar.model.fusion import MOVING_MPS
from jradar.progress import progress
from jradar.radar import ego_velocity
from jradar.range_image import unproject
from jradar.types import PointCloud

KEY = 22
COUNTS = (1, 3, 5)
LEAST_SNR = 10.0  # of an echo that moves by itself
NEAR_M = 0.5  # around an echo of a mover
MOTIONS = ("poses", "velocity")


class Seen(NamedTuple):
    """What one frame tells."""

    frame: data.PreparedFrame
    mixture: RangeMixture
    moving: Bool[Array, "row column"]
    velocity: Float[np.ndarray, " 3"]  # of the radar, NaN if it was not found
    movers: Float[np.ndarray, "echo 3"]


def main(argv: list[str] | None = None) -> int:
    """Run the study and return the exit code."""
    parser = study_parser("fusion", __doc__)
    parser.add_argument("records", help="records with consecutive frames")
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
            seen: list[Seen] = []
            for i in index:
                seen = [_seen(records[i], pairs[i].condition, model), *seen[:longest]]
                if len(seen) >= longest:
                    rows += [row | {"sequence": sequence} for row in _rows(seen, model)]
                done += 1
                show(done, sequence)
    write_text(options.output / "fusion.md", text := report(rows))
    print(text)


def _seen(frame: data.PreparedFrame, condition: Any, model: Model) -> Seen:
    """The distributions of a frame, and its echoes that move by themselves."""
    cloud = jax.tree.map(jnp.asarray, frame.radar)
    found = ego_velocity(
        jax.random.key(KEY), cloud, elevation=model.spec.radar.has_elevation
    )
    mixture = mixtures(jnp.asarray(condition), model)
    moving = moving_pixels(mixture, cloud, found.velocity, model.spec)
    velocity = np.asarray(found.velocity)
    return Seen(frame, mixture, moving, velocity, _fast(cloud, velocity))


def _fast(cloud: PointCloud, velocity) -> np.ndarray:
    """The strong echoes that do not fit a world that stands still, [echo, 3]."""
    xyz = np.asarray(cloud.xyz)
    away = np.linalg.norm(xyz, axis=-1, keepdims=True)
    at_rest = -xyz / np.where(away > 0, away, 1.0) @ velocity
    differs = np.abs(np.asarray(cloud.velocity) - at_rest) > MOVING_MPS
    strong = np.asarray(cloud.snr) > LEAST_SNR
    return xyz[np.asarray(cloud.valid) & differs & strong]


def _rows(seen: Sequence[Seen], model: Model) -> list[dict[str, Any]]:
    """The scores of the newest frame, by number of frames and kind of motion."""
    rows = []
    for motion in MOTIONS:
        poses = relative_poses(seen, motion)
        for count in COUNTS:
            if count == 1 and motion != MOTIONS[0]:
                continue
            used = [s.mixture for s in seen[:count]]
            started = time.perf_counter()
            image = fuse(
                jax.tree.map(lambda *values: jnp.stack(values), *used),
                jnp.asarray(poses[:count], jnp.float32),
                model.spec,
                moving=jnp.stack([s.moving for s in seen[:count]]),
            )
            range_m = np.asarray(image.range_m)
            took = time.perf_counter() - started
            cloud = points_of(unproject(range_m, model.spec.fine))
            rows.append(
                {"method": "one frame" if count == 1 else f"{count} frames, {motion}"}
                | _scores(cloud, seen[0])
                | {"milliseconds": 1e3 * took, "points": len(cloud)}
            )
    return rows


def relative_poses(seen: Sequence[Seen], motion: str) -> Float[np.ndarray, "frame 4 4"]:
    """Return the transforms from each frame's radar to the first one's."""
    if motion == "poses":
        now = np.linalg.inv(seen[0].frame.world_from_radar)
        return np.stack([now @ s.frame.world_from_radar for s in seen])
    poses = np.tile(np.eye(4), (len(seen), 1, 1))
    for k in range(1, len(seen)):
        newer, older = seen[k - 1], seen[k]
        step_s = newer.frame.stamp - older.frame.stamp
        speed = np.nan_to_num((newer.velocity + older.velocity) / 2)
        poses[k, :3, 3] = poses[k - 1, :3, 3] - step_s * speed
    return poses


def _scores(cloud: np.ndarray, seen: Seen) -> dict[str, float]:
    """Distances and F-score, and recall near movers; NaN without a truth."""
    truth = np.asarray(seen.frame.lidar_xyz)
    nan = float("nan")
    if not len(truth):
        return {"chamfer": nan, "hausdorff": nan, "f_score": nan, "near_movers": nan}
    score = compare_on_host(cloud, truth)
    recall = nan
    if len(seen.movers):
        near = truth[KDTree(seen.movers).query(truth)[0] <= NEAR_M]
        if len(near) and len(cloud):
            recall = float(np.mean(KDTree(cloud).query(near)[0] <= 0.2))
    return {
        "chamfer": float(score.chamfer),
        "hausdorff": float(score.modified_hausdorff),
        "f_score": float(np.nan_to_num(score.f_score[1])),
        "near_movers": recall,
    }


def report(rows: list[dict[str, Any]]) -> str:
    """Return the tables of scores and of differences from one frame."""
    methods = [*dict.fromkeys(row["method"] for row in rows)]
    by = {name: [row for row in rows if row["method"] == name] for name in methods}

    def mean(name, key, scale=1.0, digits=3):
        return f"{scale * known_mean(row[key] for row in by[name]):.{digits}f}"

    scores = [
        [
            name,
            mean(name, "chamfer"),
            mean(name, "hausdorff"),
            mean(name, "f_score", 100, 1),
            mean(name, "near_movers", 100, 1),
            mean(name, "points", 1, 0),
            f"{np.median([row['milliseconds'] for row in by[name]]):.0f}",
        ]
        for name in methods
    ]
    titles = ["method", "Chamfer (m)", "MHD (m)", "F-score (%)", "near movers (%)"]
    titles += ["points", "fusion (ms)"]
    text = f"{len(by[methods[0]])} frames\n\n" + markdown_table(titles, scores)
    single = by[methods[0]]
    changes = []
    for name in methods[1:]:
        cells = [name]
        for key, scale in (("f_score", 100), ("chamfer", 1)):
            change = [
                scale * (a[key] - b[key]) for a, b in zip(by[name], single, strict=True)
            ]
            sequences = [row["sequence"] for row in single]
            cells.append(_interval(change, sequences))
        changes.append(cells)
    titles = ["against one frame", "F-score (points)", "Chamfer (m)"]
    return text + "\n" + markdown_table(titles, changes)


def _interval(values: Sequence[float], sequences: Sequence[str]) -> str:
    """The mean with half of a 95 % interval; frames of a sequence are correlated."""
    groups: dict[str, list[float]] = {}
    for value, sequence in zip(values, sequences, strict=True):
        groups.setdefault(sequence, []).append(value)
    found = evaluation.mean_interval([np.array(group) for group in groups.values()])
    return f"{found.mean:+.2f} ± {(found.high - found.low) / 2:.2f}"


if __name__ == "__main__":
    sys.exit(main())
