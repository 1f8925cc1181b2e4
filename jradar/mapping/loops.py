"""Loops of a walk: where the radar comes back, its poses are made to agree; host.

    poses, found = close_loops(clouds, poses)

Odometry drifts, so a wall that is seen again is drawn twice. Nodes stand along the
path, each with the points around it. Two nodes that may be at one place, as far as the
drift is known, are registered by small_gicp (Koide 2024). GTSAM (Dellaert and Kaess
2017) then finds the poses of all nodes that fit the odometry and the registrations
best. Cauchy's loss (Lee et al. 2013) leaves out the few that contradict the others.

A second round finds the loops anew, from better poses. Corridors that look alike cannot
be distinguished if the drift could have led from one to the other.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from jradar.errors import optional
from jradar.lidar import interpolate_poses
from jradar.motion.scans import to_poses

STEP_M = 2.0  # of the path, between nodes
REACH_M = 3.0  # of the path, to both sides, whose points belong to a node
MOST_FRAMES = 80  # of a node
VOXEL_M = 0.3  # one point is kept of each
FEWEST_POINTS = 100  # of a node that can be registered
APART_M = 15.0  # of the path, between nodes of a loop
NEAR_M, DRIFT = 2.0, 0.03  # between nodes at one place, and more by share of the path
NEAREST = 2  # nodes that are tried, for each
COARSE_M, FINE_M = 1.0, 0.5  # between points of one surface, first and last
LEAST_SHARE = 0.75  # of the points, within FINE_M of the other node's
ROUNDS = 2
# Standard deviations in rad and m: of the first pose, the odometry and a registration.
EXACT = (1e-6,) * 6
ODOMETRY = (math.radians(0.3),) * 3 + (0.05,) * 3
LOOP = (math.radians(2),) * 3 + (0.1,) * 3

Transform = Float[np.ndarray, "4 4"]
Transforms = Float[np.ndarray, "frame 4 4"]


class Loop(NamedTuple):
    """Two nodes of a path at one place."""

    target: int
    source: int
    target_from_source: Transform
    share: float  # of the source's points on surfaces of the target


def close_loops(
    clouds: Sequence[Float[np.ndarray, "point 3"]],
    poses: Transforms,
    *,
    advance: Callable[[float], None] = lambda share: None,
) -> tuple[Transforms, list[Loop]]:
    """Return poses of the frames in which loops are closed, and the loops.

    The clouds are in metres, in the frame of their poses, and hold what stands still.
    The first pose stays. Without a loop the poses are those that were given. `advance`
    is called with the share that is done, 0 to 1. Raises ImportError without the extra
    `loops`.
    """
    path = path_lengths(poses[:, :3, 3])
    if path[-1] < APART_M:
        return poses, []
    nodes = np.unique(np.searchsorted(path, np.arange(0, path[-1], STEP_M)))
    places, parts = [], (1 + ROUNDS) * len(nodes)
    for done, node in enumerate(nodes, 1):
        places.append(_place(clouds, poses, path, node))
        advance(done / parts)
    along, first = path[nodes], poses[nodes]
    found, loops = first, []
    for number in range(1, 1 + ROUNDS):
        loops = []
        for done in range(len(nodes)):
            loops += _loops(done, places, along, found)
            advance((number * len(nodes) + done + 1) / parts)
        if not loops:
            return poses, []
        found = _optimised(first, loops)
    changes = to_poses(along, found @ np.linalg.inv(first))
    changed = interpolate_poses(changes, np.clip(path, along[0], along[-1]))
    return changed @ poses, loops


def check_libraries() -> None:
    """Raise ImportError without the extra `loops`, before a walk is read for it."""
    for name in ("small_gicp", "gtsam"):
        _library(name)


def path_lengths(path: Float[np.ndarray, "frame 3"]) -> Float[np.ndarray, " frame"]:
    """Return the metres from the first place to each, along the path."""
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    return np.r_[0.0, np.cumsum(steps)]


def _place(clouds, poses, path, node):
    """Return the points around a node in its frame, and their tree; None if few."""
    gicp = _library("small_gicp")
    low, high = np.searchsorted(path, path[node] + [-REACH_M, REACH_M])
    frames = np.arange(low, max(high, node + 1))
    frames = frames[:: -(-len(frames) // MOST_FRAMES)]
    to_node = np.linalg.inv(poses[node]) @ poses[frames]
    moved = [
        clouds[k] @ to[:3, :3].T + to[:3, 3]
        for k, to in zip(frames, to_node, strict=True)
    ]
    xyz = np.concatenate(moved).astype(float)
    if len(xyz) < FEWEST_POINTS:
        return None
    points = gicp.voxelgrid_sampling(xyz, VOXEL_M)
    return (points, gicp.KdTree(points)) if points.size() >= FEWEST_POINTS else None


def _loops(source, places, along, poses):
    """Yield the loops from a node to earlier ones that may be near it."""
    before = np.flatnonzero(along[source] - along >= APART_M)
    away = np.linalg.norm(poses[before, :3, 3] - poses[source, :3, 3], axis=1)
    near = away <= NEAR_M + DRIFT * (along[source] - along[before])
    for target in before[near][np.argsort(away[near])[:NEAREST]]:
        if places[source] is None or places[target] is None:
            continue
        guess = np.linalg.inv(poses[target]) @ poses[source]
        at, share = _registered(places[target], places[source], guess)
        if share >= LEAST_SHARE:
            yield Loop(int(target), source, at, share)


def _registered(target, source, guess):
    """Return target_from_source, and the share of points on surfaces of both."""
    gicp = _library("small_gicp")
    (points, tree), (moved, _) = target, source
    share = 0.0
    for within_m in (COARSE_M, FINE_M):
        found = gicp.align(
            points,
            moved,
            tree,
            init_T_target_source=guess,
            registration_type="ICP",
            max_correspondence_distance=within_m,
            max_iterations=50,
        )
        guess = found.T_target_source
        share = found.num_inliers / moved.size() if found.converged else 0.0
    return guess, share


def _optimised(poses, loops):
    """Return the poses of nodes that fit the odometry and the loops best."""
    gtsam = _library("gtsam")
    noise, graph = gtsam.noiseModel, gtsam.NonlinearFactorGraph()
    start = gtsam.Values()
    for number, pose in enumerate(poses):
        start.insert(number, gtsam.Pose3(pose))
    exact, odometry, loop = (
        noise.Diagonal.Sigmas(np.array(each)) for each in (EXACT, ODOMETRY, LOOP)
    )
    cauchy = noise.mEstimator.Cauchy.Create(1.0)
    robust = noise.Robust.Create(cauchy, loop)

    def tie(target, source, at, model):
        graph.add(gtsam.BetweenFactorPose3(target, source, gtsam.Pose3(at), model))

    graph.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(poses[0]), exact))
    steps = np.linalg.inv(poses[:-1]) @ poses[1:]
    for number, step in enumerate(steps):
        tie(number, number + 1, step, odometry)
    for each in loops:
        tie(each.target, each.source, each.target_from_source, robust)
    found = gtsam.LevenbergMarquardtOptimizer(graph, start).optimize()
    return np.stack([found.atPose3(k).matrix() for k in range(len(poses))])


def _library(name: str) -> Any:
    return optional(name, need=f"closing loops needs {name}", extra="loops")
