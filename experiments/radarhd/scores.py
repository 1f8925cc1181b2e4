"""Scores of occupancy images in the plane by two protocols, and the choice of limits.

    polar        a point in the middle of each occupied pixel. Near pixels are small, so
                 what is near counts more. A frame in which a method found nothing has
                 no distances and F-scores of 0, and is counted as `empty`; a frame with
                 an empty truth has no scores and is left out.
    cartesian    RadarHD's own, on an even grid: see `radarhd_cartesian`. Only these
                 scores may stand beside published ones.

Both: `chamfer` is the mean of the two mean distances to the nearest point,
`modified_hausdorff` the larger of the two medians, in metres.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from ml_collections import ConfigDict

from experiments.build import SAMPLE_KEY, random_key
from experiments.radarhd.cartesian import cartesian_points
from experiments.radarhd.confidence import counted, drawn_cells
from experiments.radarhd.pairs import PolarItems, RadarHD, polar_to_points
from experiments.tables import known_mean
from jradar.metrics import THRESHOLDS_M, compare_on_host

# Limits of the drawn value to choose from: evenly spaced log-odds.
LIMITS = 1 / (1 + np.exp(-np.arange(-5.0, 4.1, 0.25)))
CHOSEN_BY = "f_score_0.2"
SCORES = (
    "chamfer",
    "modified_hausdorff",
    *(f"f_score_{limit}" for limit in THRESHOLDS_M),
)
PROTOCOLS = {"polar": polar_to_points, "cartesian": cartesian_points}
Draw = Callable[[jax.Array, jax.Array], jax.Array]
Rows = list[dict[str, Any]]
Limits = Mapping[str, Mapping[str, float]]  # by protocol and method


def score_pairs(
    config: ConfigDict,
    pairs: RadarHD,
    draws: dict[str, Draw],
    *,
    every: int = 1,
    limits: Limits | None = None,
    protocols: Iterable[str] = ("polar",),
) -> Iterator[dict[str, Any]]:
    """Yield scores of each method on every `every`-th pair, by protocol.

    A pixel is occupied above the method's limit in this protocol; without `limits`,
    there is a row for each of LIMITS. Rows of `cartesian` also count cells by value.
    """
    key = random_key(config, SAMPLE_KEY)
    for name, images in draw_pairs(config, key, pairs, draws, every=every):
        for i, image in images:
            pair = pairs[i]
            for protocol in protocols:
                to_points = PROTOCOLS[protocol]
                truth = to_points(pair.lidar)
                tried = LIMITS if limits is None else [limits[protocol][name]]
                cells = None
                if protocol == "cartesian":
                    cells = drawn_cells(image, min(tried), truth)
                for limit in tried:
                    occupied = image > limit
                    yield {
                        "protocol": protocol,
                        "method": name,
                        "trajectory": pair.trajectory,
                        "frame": pair.frame,
                        "limit": float(limit),
                        "points": int(occupied.sum()),
                        **plane_scores(to_points(occupied), truth),
                        **(counted(cells, limit) if cells else {}),
                    }


def draw_pairs(
    config: ConfigDict,
    key: jax.Array,
    pairs: RadarHD,
    draws: dict[str, Draw],
    *,
    every: int = 1,
) -> Iterator[tuple[str, list[tuple[int, np.ndarray]]]]:
    """Yield, batch by batch, each method's images with the indices of their pairs."""
    items = PolarItems(pairs, history=config.data.history)
    index = np.arange(0, len(pairs), every)
    size = config.sampling.batch_size
    for first in range(0, len(index), size):
        part = index[first : first + size].tolist()
        padded = np.resize(part, size)  # one shape, compiled once
        condition = jnp.asarray(np.stack([items[i].condition for i in padded]))
        own_key = jax.random.fold_in(key, first)
        for name, draw in draws.items():
            images = np.asarray(draw(own_key, condition))
            yield name, [*zip(part, images, strict=False)]


def plane_scores(found: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """Return the scores of one frame; without points, by the rule of `polar`."""
    if not len(truth):
        return dict.fromkeys(SCORES, np.nan)
    if not len(found):
        return {name: 0.0 if name.startswith("f_") else np.nan for name in SCORES}
    scores = compare_on_host(found, truth)
    values = (scores.chamfer / 2, scores.modified_hausdorff, *scores.f_score)
    return {name: float(v) for name, v in zip(SCORES, values, strict=True)}


def choose_limits(rows: Iterable[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Return the limits with the best mean F-score at 0.2 m, by protocol and method."""
    scores: dict[tuple[str, str], dict[float, list[float]]] = {}
    for row in rows:
        limits = scores.setdefault((row["protocol"], row["method"]), {})
        limits.setdefault(row["limit"], []).append(row[CHOSEN_BY])
    chosen: dict[str, dict[str, float]] = {}
    for (protocol, method), found in scores.items():
        best = max(found, key=lambda limit, found=found: known_mean(found[limit]))
        chosen.setdefault(protocol, {})[method] = best
    return chosen


def at_limits(rows: Iterable[dict[str, Any]], limits: Limits) -> Rows:
    """Return the rows of each method's own limit."""
    return [r for r in rows if r["limit"] == limits[r["protocol"]][r["method"]]]


def mean_scores(rows: Rows) -> dict[str, float]:
    """Return the mean scores and the share of frames in which nothing was found."""
    means = {name: known_mean([row[name] for row in rows]) for name in SCORES}
    return {**means, "empty": known_mean([not row["points"] for row in rows])}
