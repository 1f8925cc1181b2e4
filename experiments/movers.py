"""Where the moving bodies of a simulated scene are: the truth for scores of movers."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Bool, Float
from scipy.spatial import KDTree

from jradar.lidar import transform
from jradar.simulation import make_setting
from jradar.simulation.coloradar_writer import NOTE
from jradar.simulation.scenes.scene import Scene, placements
from jradar.simulation.sequence import EPOCH_S

SURFACE_POINTS = 4000  # of each body
ON_BODY_M = 0.2  # of a LiDAR point from the body that it shows
RIGHT_M = 0.2  # of a point from a surface that it is right about
NEAR_M = 0.5  # of points that count as an answer to a mover, or as its trail
LEAST_POINTS = 20  # of the LiDAR on movers, for a score

Points = Float[np.ndarray, "point 3"]


def scene_of_recording(folder: Path) -> Scene | None:
    """Return the scene of a simulated sequence; None for another recording."""
    if not (folder / NOTE).is_file():
        return None
    family, _, seed = folder.name.rpartition("_")
    return make_setting(family, int(seed)).scene


def surfaces(scene: Scene, stamp: float) -> Points:
    """Return points on what moves by itself, in the world at the time `stamp`."""
    found = [np.zeros((0, 3))]
    places = placements(scene, stamp - EPOCH_S)
    for body, place in zip(scene.bodies[1:], places[1:], strict=True):
        mesh = trimesh.Trimesh(body.solid.vertices, body.solid.faces, process=False)
        points, _ = trimesh.sample.sample_surface(mesh, SURFACE_POINTS, seed=0)
        found.append(points @ place.turn.T + place.xyz)
    return np.concatenate(found)


def in_radar(scene: Scene, stamp: float, world_from_radar: np.ndarray) -> Points:
    """Return the `surfaces` along the axes of a radar."""
    return transform(np.linalg.inv(world_from_radar), surfaces(scene, stamp))


def mover_scores(
    cloud: Points, truth: Points, now: Points, before: Sequence[Points]
) -> dict[str, float]:
    """Return how well a cloud shows movers, and how many points are left behind them.

    `now` and `before` are points on the movers at the time of the truth and earlier.
    Recall is of the LiDAR's points on movers; precision of the cloud's points within
    0.5 m of a mover. Trailing points lie within 0.5 m of where a mover was, and are
    more than 0.2 m from all that is there now. All are NaN where the LiDAR hardly sees
    a mover.
    """
    names = ("mover_recall", "mover_precision", "mover_f", "trail")
    if not len(now) or (_within(truth, now, ON_BODY_M)).sum() < LEAST_POINTS:
        return dict.fromkeys(names, float("nan"))
    theirs = truth[_within(truth, now, ON_BODY_M)]
    recall = float(_within(theirs, cloud, RIGHT_M).mean())
    near = cloud[_within(cloud, now, NEAR_M)]
    precision = float(_within(near, truth, RIGHT_M).mean()) if len(near) else 0.0
    both = recall + precision
    trail = _within(cloud, np.concatenate(before), NEAR_M)
    trail &= ~_within(cloud, now, RIGHT_M) & ~_within(cloud, truth, RIGHT_M)
    f_score = 2 * recall * precision / both if both else 0.0
    return dict(
        zip(names, (recall, precision, f_score, float(trail.sum())), strict=True)
    )


def _within(
    points: Points, others: Points, metres: float
) -> Bool[np.ndarray, " point"]:
    """Which points have one of the others within a distance."""
    if not len(points) or not len(others):
        return np.zeros(len(points), bool)
    return KDTree(others).query(points, distance_upper_bound=metres)[0] < np.inf
