"""What makes weights a model that `jradar enhance` takes, and whether one can trust it.

The confidence is fitted to pairs that the network was not trained on. These are of the
training's building, so they are also rotated, and their rooms made smaller and larger:
there, a network's answer disagrees with that to the mirror image, and is less often
right. A network that also trained on simulated pairs has a group of those that were
spared. They alone have the radar's points.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from ml_collections import ConfigDict

from experiments import build
from experiments.radarhd.model import build_spec
from experiments.radarhd.pairs import PolarItems, RadarHD
from experiments.radarhd.scores import building, polar_points
from jradar.evaluation import (
    Judged,
    fitted,
    judged_answer,
    markdown_table,
    spread,
    trust_of,
)
from jradar.metrics import near_truth
from jradar.model import Card, Model, Tables, draw
from jradar.model.grids.polar import LIDAR, RADARHD
from jradar.radar import PointSpec
from jradar.types import PointCloud

MOST_IMAGES = 2000  # of training, which are described
FITTED_FRAMES = 40  # of each rotation and size
SIMULATED_FRAMES = 240
MOST_POINTS = PointSpec().capacity  # of the radar in a frame
KEY = 0


def described(
    config: ConfigDict, params: Any, spared: Sequence[RadarHD], trained: Sequence
) -> Model:
    """Return the model of parameters, its confidence fitted to the spared pairs.

    Real pairs come first in both, then simulated ones if any.
    """
    card = Card(
        purpose=config.purpose,
        steps_seen=config.train.steps_before + config.train.steps,
        trained_on="RadarHD's dataset_5, whose licence is not stated"
        + ", and simulated pairs" * (len(trained) > 1),
        radars=(RADARHD,),
    )
    spec = build_spec(config)
    images = (PolarItems(pairs, history=1) for pairs in trained)
    trust = trust_of(spec.frame_grid, *images, most=MOST_IMAGES)
    model = Model(params, spec, Tables(trust=trust), card)
    real, *simulated = spared
    index = spread(len(real), FITTED_FRAMES)
    with build.section("confidence"):
        places = [
            real.rotated(turn).scaled(size)
            for size in (1.0, *config.confidence.sizes)
            for turn in config.confidence.turns
        ]
    groups = [[*judged_pairs(model, pairs, index)] for pairs in places]
    for pairs in simulated:
        index = spread(len(pairs), SIMULATED_FRAMES)
        groups.append([*judged_pairs(model, pairs, index)])
    return fitted(model, groups)


def judged_pairs(
    model: Model, pairs: RadarHD, index: Sequence[int]
) -> Iterator[Judged]:
    """Yield the points of the model's answers to pairs that have a truth."""
    items = PolarItems(pairs, history=model.spec.frame_grid.history)
    for i in index:
        pair, key = pairs[i], jax.random.fold_in(jax.random.key(KEY), i)
        truth = polar_points(pair.lidar)
        radar = None if pair.points is None else _padded(pair.points)
        found = judged_answer(key, model, items[i].condition, truth, radar)
        if found is not None and len(truth):
            yield found


def _padded(xyz: np.ndarray) -> PointCloud:
    """Points with zeros after them, which are not valid: one shape, compiled once."""
    padded = np.zeros((MOST_POINTS, 3), np.float32)
    padded[: len(xyz)] = xyz[:MOST_POINTS]
    return PointCloud.from_xyz(padded)


def reliability_table(model: Model, pairs: RadarHD, index: Sequence[int]) -> str:
    """Return Markdown: by building, how sure the model is of its pixels, and how right.

    Pixels that are left out do not count. The last column is that of the same table of
    confidence without its scaling.
    """
    models = model, model.with_tables(scaling=None)
    items = PolarItems(pairs, history=model.spec.frame_grid.history)
    seen: dict[str, list[tuple[np.ndarray, ...]]] = defaultdict(list)
    for i in index:
        pair, key = pairs[i], jax.random.fold_in(jax.random.key(KEY), i)
        truth, condition = polar_points(pair.lidar), jnp.asarray(items[i].condition)
        found = []
        for each in models if len(truth) else ():
            said = np.asarray(draw(key, condition, each).confidence)
            kept = said > 0
            found += [said[kept], near_truth(LIDAR.xyz[kept], truth)]
        if found:
            seen[building(pair.trajectory)].append(tuple(found))
    rows = []
    for place, frames in seen.items():
        said, right, before, right_before = map(
            np.concatenate, zip(*frames, strict=True)
        )
        row = [place, f"{len(said):,}", *[""] * 4]
        if len(said):
            sure, share, error = _shares(said, right)
            *_, before = _shares(before, right_before)
            row[2:] = f"{sure:.1f}", f"{share:.1f}", f"{error:+.1f}", f"{before:+.1f}"
        rows.append(row)
    columns = ["trajectories", "pixels", "confidence (%)", "right (%)", "too sure by"]
    return markdown_table([*columns, "not scaled"], rows)


def _shares(said, right):
    """Mean confidence, share of right pixels and their difference, in percent."""
    sure, share = 100 * said.mean(dtype=float), 100 * right.mean()
    return sure, share, sure - share
