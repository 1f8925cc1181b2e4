"""Scores of occupancy images by two protocols, and their limits.

    polar        a point in the middle of each occupied pixel. Near pixels are small, so
                 what is near counts more.
    cartesian    RadarHD's own (its folder eval/). Only these scores may stand next to
                 published ones. Pixels go to a grid of 256 rows, x (forward) from 0 to
                 10.8 m, and 512 columns, y (left) from -10.8 to 10.8 m, both evenly
                 spaced with both ends: to the first value that is not below their x,
                 and likewise for y. An image without a point becomes the one point
                 (0, 0, 0).

Rows of scores are those of `jradar.evaluation`, with the building as scene and the
protocol as truth, but `chamfer` is the mean of the two mean distances, as in RadarHD,
not their sum. RadarHD has no F-score, and its code stops at images with exactly one
occupied cell, which count as one point here.

A pixel is occupied where an image exceeds a limit, chosen for each method and protocol.
"""

import functools
import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from ml_collections import ConfigDict

from experiments.build import SAMPLE_KEY, random_key
from experiments.radarhd.model import Answers
from experiments.radarhd.pairs import PolarItems, PolarPair, RadarHD
from jradar import evaluation
from jradar.evaluation.methods import known_mean
from jradar.model.grids.polar import LIDAR, MAX_RANGE_M

# Limits of the drawn value to choose from: evenly spaced log-odds.
LIMITS = 1 / (1 + np.exp(-np.arange(-5.0, 4.1, 0.25)))
X_GRID = np.linspace(0, MAX_RANGE_M, 256)
Y_GRID = np.linspace(-MAX_RANGE_M, MAX_RANGE_M, 512)
BUILDINGS = {  # of the public folder, by its trajectories with both ends included
    (112, 140): "112 to 140, building of the training trajectories",
    (227, 246): "227 to 246, another building",
    (247, 250): "247 to 250, another building",
}

Rows = list[dict[str, Any]]
Limits = Mapping[str, Mapping[str, float]]  # by protocol and method
Occupied = Bool[np.ndarray, "range azimuth"]
Points = Float[np.ndarray, "point 3"]


def building(trajectory: int) -> str:
    """Return the building of a trajectory of the public folder."""
    inside = (n for (low, high), n in BUILDINGS.items() if low <= trajectory <= high)
    return next(inside, "unknown building")


def polar_points(occupied: Occupied) -> Points:
    """Return the points of the occupied pixels in the plane z = 0; on the host."""
    return LIDAR.xyz[occupied]


def cartesian_points(occupied: Occupied) -> Points:
    """Return the points of the cells of the occupied pixels; on the host."""
    row, column = pixel_cells()
    cells = np.zeros((len(X_GRID), len(Y_GRID)), bool)
    cells[row[occupied], column[occupied]] = True
    x, y = np.nonzero(cells)
    points = np.stack([X_GRID[x], Y_GRID[y], np.zeros(len(x))], -1)
    return points if len(points) else np.zeros((1, 3))


PROTOCOLS = {"polar": polar_points, "cartesian": cartesian_points}


@functools.cache
def pixel_cells() -> tuple[Int[np.ndarray, "range azimuth"], ...]:
    """Return the row and the column of the Cartesian cell of each polar pixel."""
    sine = np.sin(LIDAR.angles)
    distance = LIDAR.ranges[:, None]
    y, x = distance * sine, distance * np.sqrt(1 - sine**2)
    places = ((X_GRID, x), (Y_GRID, y))
    return tuple(np.searchsorted(grid, value) % len(grid) for grid, value in places)


def drawn_images(
    config: ConfigDict,
    pairs: RadarHD,
    answers: Answers,
    index: Sequence[int],
    *,
    methods: int | None = None,
) -> Iterator[tuple[PolarPair, str, Float[np.ndarray, "range azimuth"]]]:
    """Yield the pairs of an index with each method's name and image.

    `methods` is the number of methods, the quickest first.
    """
    items = PolarItems(pairs, history=config.data.history)
    size, key = config.sampling.batch_size, random_key(config, SAMPLE_KEY)
    for first in range(0, len(index), size):
        part = index[first : first + size]
        padded = np.resize(part, size)  # one shape, compiled once
        condition = jnp.asarray(np.stack([items[i].condition for i in padded]))
        found = answers(jax.random.fold_in(key, first), condition)
        drawn = [(name, np.asarray(i)) for name, i in itertools.islice(found, methods)]
        for place, pair in enumerate(pairs[i] for i in part):
            for name, images in drawn:
                yield pair, name, images[place]


def score_pairs(
    config: ConfigDict,
    pairs: RadarHD,
    answers: Answers,
    *,
    every: int,
    limits: Limits | None = None,
    protocols: Iterable[str] = PROTOCOLS,
    methods: int | None = None,
) -> Iterator[dict[str, Any]]:
    """Yield scores of each method on every `every`-th pair, by protocol.

    Without `limits`, there is a row for each of LIMITS. A row has its limit besides the
    fields of `jradar.evaluation`.
    """
    index = range(0, len(pairs), every)
    drawn = drawn_images(config, pairs, answers, index, methods=methods)
    for pair, name, image in drawn:
        for protocol in protocols:
            to_points = PROTOCOLS[protocol]
            truth = to_points(pair.lidar)
            tried = LIMITS if limits is None else [limits[protocol][name]]
            for limit in tried:
                occupied = image > limit
                scores = evaluation.score_points(to_points(occupied), truth)
                yield {
                    "scene": building(pair.trajectory),
                    "sequence": str(pair.trajectory),
                    "frame": pair.frame,
                    "truth": protocol,
                    "method": name,
                    "points": int(occupied.sum()),
                    "truth_points": len(truth),
                    "milliseconds": np.nan,  # methods share what they draw
                    **scores,
                    "chamfer": scores["chamfer"] / 2,
                    "limit": float(limit),
                }


def choose_limits(rows: Iterable[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Return the limits with the best mean F-score at 0.2 m, by protocol and method."""
    scores: dict[tuple[str, str], dict[float, list[float]]] = {}
    for row in rows:
        limits = scores.setdefault((row["truth"], row["method"]), {})
        limits.setdefault(row["limit"], []).append(row["f_score_0.2"])
    chosen: dict[str, dict[str, float]] = {}
    for (protocol, method), found in scores.items():
        means = {limit: known_mean(values) for limit, values in found.items()}
        chosen.setdefault(protocol, {})[method] = max(means, key=means.__getitem__)
    return chosen


def at_limits(rows: Iterable[dict[str, Any]], limits: Limits) -> Rows:
    """Return the rows of each method's own limit."""
    return [r for r in rows if r["limit"] == limits[r["truth"]][r["method"]]]
