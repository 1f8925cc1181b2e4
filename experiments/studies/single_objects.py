r"""Score models on single objects in empty space: where, how wide, how high?

    python -m experiments.studies.single_objects -o runs/objects --model jradar-sim

A pillar, a table, a beam and a corner reflector stand alone, 2 to 10 m straight ahead
and 25 degrees aside. The radar is the AWR1843 of ColoRadar at rest, 1.2 m above the
foot of the objects. `objects.md` has a row for each object and distance, the mean of
the places: in how many of them a point lies within 0.5 m of the object, the error of
its distance, its width and height, and the points in the air, farther than 0.5 m from
it. The first row of a distance is the LiDAR's.
"""

import itertools
import sys
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from experiments.build import build_pairs, prepare_spec
from experiments.command import run_study, study_parser
from experiments.configs import marginal
from jradar import data
from jradar.data.frames import prepare_frame
from jradar.evaluation import MethodInput, drawn, markdown_table, points_of
from jradar.files import write_text
from jradar.model import load_model
from jradar.simulation.drawn import TIME_S, described, recording_of
from jradar.simulation.scenes.layouts import EYE_M
from jradar.simulation.scenes.scene import Scene, make_body
from jradar.simulation.scenes.solids import (
    Solid,
    box,
    join,
    moved,
    pole,
    posts,
    sheet,
)
from jradar.simulation.scenes.trajectory import pose_at, walk
from jradar.simulation.sequence import Setting, carried
from jradar.simulation.units import UnitSpec

HEIGHT_M = EYE_M  # of the radar above the foot of the objects
TRUTH = "LiDAR"
Row = tuple[str, float, str]  # object, distance and method
DISTANCES_M = (2.0, 4.0, 6.0, 8.0, 10.0)
BEARINGS = tuple(np.radians([0.0, 25.0, -25.0]))
NEAR_M = 0.5  # farther from everything, a point is in the air
UNIT = UnitSpec(speed_mps=0.0)
WAY = HEIGHT_M * np.array(
    [[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1.0]]
)  # a square


class Case(NamedTuple):
    """An object at a place."""

    thing: str
    distance_m: float
    bearing: float


class Seen(NamedTuple):
    """What a cloud shows of an object; NaN where it shows nothing."""

    found: float
    distance_m: float
    width_m: float
    height_m: float
    in_the_air: float


def pillar() -> Solid:
    """A pillar of concrete, 0.5 m wide and 2 m high."""
    return pole(0.25, 2.0, "concrete", sides=24)


def table() -> Solid:
    """A table of wood with legs of metal."""
    legs = posts((0.06, 0.06, 0.72), "metal", (-0.35, 0.35), (-0.6, 0.6))
    return join([moved(box((0.8, 1.4, 0.04), "wood"), (0, 0, 0.72)), *legs])


def beam() -> Solid:
    """A beam of metal, 3 m long, overhead."""
    return moved(box((0.2, 3.0, 0.25), "metal"), (0, 0, 1.7))


def trihedral() -> Solid:
    """A corner reflector of 0.2 m, 0.3 m below the radar, open towards -x and up."""
    a = 0.2
    faces = (
        [(0, 0, 0), (a, 0, 0), (a, a, 0), (0, a, 0)],
        [(0, 0, 0), (0, 0, a), (a, 0, a), (a, 0, 0)],
        [(0, 0, 0), (0, a, 0), (0, a, a), (0, 0, a)],
    )
    solid = join([sheet(face, "metal") for face in faces])
    return moved(solid, (0, 0, HEIGHT_M - 0.3), yaw=0.75 * np.pi)


THINGS: dict[str, Callable[[], Solid]] = {
    "pillar": pillar,
    "table": table,
    "beam": beam,
    "trihedral": trihedral,
}


def main(argv: list[str] | None = None) -> int:
    """Run the study and return the exit code."""
    parser = study_parser("experiments.studies.single_objects", __doc__)
    text = "shipped model, or a folder"
    parser.add_argument("--model", action="append", default=[], help=text)
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Simulate the cases, let the models answer, and write the table."""
    models = {name: load_model(name) for name in options.model or ["jradar-sim"]}
    cases = [Case(t, d, b) for t in THINGS for d in DISTANCES_M for b in BEARINGS]
    settings = [*map(setting_of, cases)]
    radar = described(*settings[0].radars["single_chip"])
    recording = recording_of(settings.__getitem__, len(cases), radar, name="objects")
    spec = prepare_spec(marginal.get_config())
    frames = [prepare_frame(recording, k, k, spec)[0] for k in range(len(cases))]
    truths = [data.lidar_in_view(recording, frame, spec.lidar) for frame in frames]
    clouds = {TRUTH: truths}
    for name, model in models.items():
        method, pairs = drawn(model), build_pairs(model.spec, frames)
        answers = itertools.starmap(MethodInput, zip(frames, pairs, strict=True))
        clouds[name] = [
            points_of(method(jax.random.key(0), frame)) for frame in answers
        ]
    rows: dict[Row, list[Seen]] = {}
    for k, case in enumerate(cases):
        for name, found in clouds.items():
            row = rows.setdefault((case.thing, case.distance_m, name), [])
            row.append(seen_of(found[k], truths[k]))
    write_results(options.output, rows)


def setting_of(case: Case) -> Setting:
    """Return an object alone in the world, ahead of a radar at rest."""
    random = np.random.default_rng(0)  # of the speckle
    platform = walk(random, WAY, speed_mps=0.0, rounding_m=0.2)
    xyz, turn = pose_at(platform, TIME_S)
    heading = np.arctan2(turn[1, 0], turn[0, 0]) + case.bearing
    x, y = xyz[:2] + case.distance_m * np.array([np.cos(heading), np.sin(heading)])
    solid = moved(THINGS[case.thing](), (x, y, 0.0), yaw=heading)
    scene = Scene(case.thing, (make_body(random, solid),), platform)
    return carried(scene, 0, UNIT)


def seen_of(
    found: Float[np.ndarray, "point 3"], truth: Float[np.ndarray, "other 3"]
) -> Seen:
    """Return what the points near the truth show, and how many are not near it."""
    if not len(found) or not len(truth):
        return Seen(0.0, np.nan, np.nan, np.nan, float(len(found)))
    near = cKDTree(truth).query(found)[0] <= NEAR_M
    if not near.any():
        return Seen(0.0, np.nan, np.nan, np.nan, float(len(found)))
    middle = truth[:, :2].mean(0)
    ahead = middle / np.linalg.norm(middle)
    forward = found[near, :2] @ ahead
    aside = found[near, :2] @ np.array([-ahead[1], ahead[0]])
    size = (_extent(values) for values in (aside, found[near, 2]))
    return Seen(1.0, float(np.median(forward)), *size, float((~near).sum()))


def _order(item):
    (thing, distance, name), _ = item
    return [*THINGS].index(thing), distance, name != TRUTH, name


def _extent(values) -> float:
    """The length that holds the middle 90 % of values."""
    low, high = np.quantile(values, (0.05, 0.95))
    return float(high - low)


def write_results(folder: Path, rows: dict[Row, list[Seen]]) -> None:
    """Write and print the table of the means over the places."""
    lines = []
    for (thing, distance, name), seen in sorted(rows.items(), key=_order):
        known = [values for values in seen if values.found]
        place, width, height = np.mean([s[1:4] for s in known] or [[np.nan] * 3], 0)
        true = np.nanmean([s.distance_m for s in rows[thing, distance, TRUTH]])
        air = np.mean([values.in_the_air for values in seen])
        line = [thing, f"{distance:g}", name, f"{len(known)} of {len(seen)}"]
        lines.append(
            line + [f"{v:.2f}" for v in (place - true, width, height)] + [f"{air:,.0f}"]
        )
    table = markdown_table(
        [
            "object",
            "at (m)",
            "",
            "found",
            "off by (m)",
            "wide (m)",
            "high (m)",
            "points in the air",
        ],
        lines,
    )
    write_text(folder / "objects.md", table)
    print(table)


if __name__ == "__main__":
    sys.exit(main())
