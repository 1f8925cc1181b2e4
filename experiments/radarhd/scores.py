"""Scores of occupancy images by two protocols, limits, and confidence of cells.

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
A drawn Cartesian cell is right if the LiDAR has one within 0.2 m. What an image says of
it, a probability, a share of draws or a nearness, is not the frequency of that:
`fit_confidences` turns the one into the other.
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
from experiments.evaluate import known_mean
from experiments.radarhd.model import Answers
from experiments.radarhd.pairs import LIDAR, MAX_RANGE_M, PolarItems, PolarPair, RadarHD
from jradar import evaluation
from jradar.range_image import ConfidenceTable, fit_confidence, frequency
from jradar.range_image.confidence import KNOTS

# Limits of the drawn value to choose from: evenly spaced log-odds.
LIMITS = 1 / (1 + np.exp(-np.arange(-5.0, 4.1, 0.25)))
FULL = 255  # the grey value of an occupied pixel
X_GRID = np.linspace(0, MAX_RANGE_M, 256)
Y_GRID = np.linspace(-MAX_RANGE_M, MAX_RANGE_M, 512)
BUILDINGS = {  # of the public folder, by its trajectories with both ends included
    (112, 140): "112 to 140, building of the training trajectories",
    (227, 246): "227 to 246, another building",
    (247, 250): "247 to 250, another building",
}
CONFIDENCE = ("cells", "value (%)", "confidence (%)", "right (%)", "error (points)")

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
    row, column = np.nonzero(occupied)
    distance, azimuth = LIDAR.ranges[row], LIDAR.angles[column]
    xyz = [distance * np.cos(azimuth), distance * np.sin(azimuth), 0 * distance]
    return np.stack(xyz, -1)


def cartesian_points(occupied: Occupied) -> Points:
    """Return the points of the cells of the occupied pixels; on the host."""
    points = cell_points(to_cartesian(occupied))
    return points if len(points) else np.zeros((1, 3))


PROTOCOLS = {"polar": polar_points, "cartesian": cartesian_points}


def to_cartesian(image: np.ndarray) -> np.ndarray:
    """Return an image on the Cartesian grid; of several pixels the last one counts."""
    row, column = np.nonzero(image)
    cartesian = np.zeros((len(X_GRID), len(Y_GRID)), image.dtype)
    x, y = pixel_cells()
    cartesian[x[row, column], y[row, column]] = image[row, column]  # in order
    return cartesian


def cell_points(cells: np.ndarray) -> Points:
    """Return the grid's values of the cells that are not 0, in the plane z = 0."""
    x, y = np.nonzero(cells)
    return np.stack([X_GRID[x], Y_GRID[y], np.zeros(len(x))], -1)


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

    Without `limits`, there is a row for each of LIMITS. Besides the fields of
    `jradar.evaluation`, a row has its limit, and the cells of `count_cells`.
    """
    index = range(0, len(pairs), every)
    drawn = drawn_images(config, pairs, answers, index, methods=methods)
    for pair, name, image in drawn:
        for protocol in protocols:
            to_points = PROTOCOLS[protocol]
            truth = to_points(pair.lidar)
            tried = LIMITS if limits is None else [limits[protocol][name]]
            counted = protocol == "cartesian"
            cells = count_cells(image, min(tried), truth) if counted else None
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
                    "cells": cells,
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


def count_cells(
    image: Float[np.ndarray, "range azimuth"], limit: float, truth: Points
) -> Int[np.ndarray, "grey 2"]:
    """Return how many cells of pixels above the limit are wrong, and right, by grey."""
    grey = np.where(image > limit, np.clip(np.rint(FULL * image), 2, FULL), 0)
    cells = to_cartesian(grey.astype(np.uint8))
    right = evaluation.near_truth(cell_points(cells), truth).astype(int)
    counts = np.zeros((FULL + 1, 2), int)
    np.add.at(counts, (cells[cells > 0], right), 1)
    return counts


def drawn_cells(rows: Rows) -> tuple[Float[np.ndarray, " cell"], np.ndarray]:
    """Return the value of each cell above its row's limit, and whether it is right.

    Values are rounded to the knots of a calibration.
    """
    level = np.arange(FULL + 1)[:, None] / FULL
    counts = sum(np.where(level > r["limit"], r["cells"], 0) for r in rows)
    value = np.rint(level * (KNOTS - 1)) / (KNOTS - 1)
    both = np.broadcast_arrays(value, [False, True])
    value, right = (np.repeat(part.ravel(), counts.ravel()) for part in both)
    return value, right


def fit_confidences(rows: Rows) -> dict[str, ConfidenceTable]:
    """Return the frequency of right cells by value, for each method.

    Without a drawn cell every value is its own frequency.
    """
    fitted = {}
    for (method,), mine in _with_cells(rows, "method"):
        value, right = drawn_cells(mine)
        nothing = ConfidenceTable.of((0.0, 1.0))
        fitted[method] = fit_confidence(value, right) if len(value) else nothing
    return fitted


def confidence_table(rows: Rows, confidence: Mapping[str, ConfidenceTable]) -> str:
    """Return a table of how well the confidence holds, by building and method."""
    lines = []
    for place, mine in _with_cells(rows, "scene", "method"):
        value, right = drawn_cells(mine)
        if len(value):
            sure = np.asarray(frequency(value, confidence[place[1]]))
            error = evaluation.reliability_error(evaluation.reliability(sure, right))
            shares = [value.mean(), sure.mean(), right.mean(), error]
            texts = [f"{100 * share:.1f}" for share in shares]
            lines.append([*place, f"{len(value):,}", *texts])
    return evaluation.markdown_table(["building", "method", *CONFIDENCE], lines)


def _with_cells(rows: Rows, *names: str):
    """The rows that count cells, grouped by fields."""
    groups: dict[tuple, Rows] = {}
    for row in rows:
        if row["cells"] is not None:
            groups.setdefault(tuple(row[name] for name in names), []).append(row)
    return groups.items()
