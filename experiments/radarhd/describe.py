"""What makes weights a model that `jradar enhance` takes, and whether one can trust it.

The confidence is fitted to pairs that the network was not trained on: a pixel is right
if the LiDAR has a point within 0.2 m of it. These pairs are of the training's building,
so they are also rotated, and their rooms made smaller and larger. There, a network's
answer disagrees with that to the mirror image, and is less often right.
"""

import dataclasses
import functools
import itertools
import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from ml_collections import ConfigDict

from experiments import build
from experiments.radarhd.model import networks
from experiments.radarhd.pairs import PolarItems, RadarHD
from experiments.radarhd.scores import building, polar_points
from jradar.evaluation import (
    Judged,
    fitted_confidence,
    least_confidence,
    markdown_table,
    near_truth,
    spread,
)
from jradar.model import Card
from jradar.planar import (
    LIDAR,
    RADARHD,
    UNSCALED,
    Pixels,
    PlanarModel,
    PlanarSpec,
    both_ways,
    fit_scaling,
    image_features,
    scaled,
)
from jradar.range_image import (
    IDENTITY,
    ConfidenceTable,
    TrustTable,
    fit_trust,
    frequency,
)
from jradar.range_image.trust import LEAST_FRAMES

FAINT = 0.02  # value of a pixel that is never a point
MOST_IMAGES = 2000  # of training, which are described
FITTED_FRAMES = 40  # of each rotation and size


class Answer(NamedTuple):
    """A trajectory, the pixels of its answer to one pair, and `disagreement`."""

    trajectory: int
    pixels: Judged
    disagreement: float


Groups = Sequence[Sequence[Answer]]


def described(
    config: ConfigDict, params: Any, spared: RadarHD, trained_on: RadarHD
) -> PlanarModel:
    """Return the model of parameters; its confidence is fitted to the spared pairs."""
    network, noise = networks(config)
    method = "nearness" if config.method == "nearness" else "occupancy"
    card = Card(
        purpose=config.purpose,
        steps_seen=config.train.steps,
        trained_on="RadarHD's dataset_5, whose licence is not stated",
        radars=(RADARHD,),
    )
    spec = PlanarSpec(network, noise, method=method, history=config.data.history)
    model = PlanarModel(params, spec, card, IDENTITY, trust_of(trained_on))
    index = spread(len(spared), FITTED_FRAMES)
    with build.section("confidence"):
        places = [
            [spared.rotated(turn).scaled(size) for turn in config.confidence.turns]
            for size in (1.0, *config.confidence.sizes)
        ]
    plain, *others = ([[*judged_answers(model, p, index)] for p in g] for g in places)
    return with_scaled_confidence(model, plain, [*itertools.chain(*others)])


def with_scaled_confidence(
    model: PlanarModel, plain: Groups, others: Groups = ()
) -> PlanarModel:
    """Return the model with a confidence that was fitted to groups of answers.

    Each group counts as much as another. The least confidence is the best one of the
    plain groups. Without a pixel in these, the model stays as it is.
    """
    plain, others = ([group for group in kind if group] for kind in (plain, others))
    if not any(len(a.pixels.xyz) for group in plain for a in group):
        return model
    groups = [*plain, *others]
    table = fitted_confidence(*([a.pixels for a in group] for group in groups))
    model = dataclasses.replace(model, confidence=table, scaling=UNSCALED)
    pixels = (
        Pixels(confidence(a, model), a.pixels.right, a.disagreement)
        for a in itertools.chain(*groups)
    )
    model = dataclasses.replace(model, scaling=fit_scaling([*pixels]))
    sure = (
        [a.pixels._replace(confidence=confidence(a, model)) for a in group]
        for group in plain
    )
    table = ConfidenceTable.of(table.frequencies, least=least_confidence(*sure))
    return dataclasses.replace(model, confidence=table)


def confidence(answer: Answer, model: PlanarModel) -> np.ndarray:
    """Return the model's confidence in the pixels of an answer, from their values."""
    said = answer.pixels.confidence
    padded = np.zeros(math.prod(LIDAR.shape), np.float32)  # one shape, compiled once
    padded[: len(said)] = said
    return np.asarray(_confidence(padded, answer.disagreement, model))[: len(said)]


@jax.jit
def _confidence(value, apart, model):
    return scaled(frequency(value, model.confidence), apart, model.scaling)


def reliability_table(model: PlanarModel, pairs: RadarHD, index: Sequence[int]) -> str:
    """Return Markdown: by building, how sure the model is of its pixels, and how right.

    Pixels of less than the model's least confidence are left out. The last column is
    that of the same table of confidence without its scaling.
    """
    unscaled = dataclasses.replace(model, scaling=UNSCALED)
    seen: dict[str, list[tuple[np.ndarray, ...]]] = defaultdict(list)
    for answer in judged_answers(model, pairs, index):
        right, parts = answer.pixels.right, []
        for each in (model, unscaled):
            said = confidence(answer, each)
            kept = said >= each.confidence.least
            parts += [said[kept], right[kept]]
        seen[building(answer.trajectory)].append(tuple(parts))
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


def trust_of(pairs: RadarHD) -> TrustTable | None:
    """Return what radar images look like in training; None of too few."""
    index = spread(len(pairs), MOST_IMAGES)
    features = [image_features(pairs.radar(i) / np.float32(255)) for i in index]
    return fit_trust(np.stack(features)) if len(index) >= LEAST_FRAMES else None


def judged_answers(
    model: PlanarModel, pairs: RadarHD, index: Sequence[int]
) -> Iterator[Answer]:
    """Yield the model's answers to pairs; pixels that are faint are left out."""
    fixed = {"network": model.spec.network, "noise": model.spec.noise}
    draw = jax.jit(functools.partial(both_ways, **fixed))
    items = PolarItems(pairs, history=model.spec.history)
    for i in index:
        condition = jnp.asarray(items[i].condition)[None]
        (value,), (apart,) = map(np.asarray, draw(condition, model.params))
        pair = pairs[i]
        seen, truth = value > FAINT, polar_points(pair.lidar)
        if len(truth):
            xyz, said = LIDAR.xyz[seen], np.minimum(value[seen], 1)
            pixels = Judged(xyz, said, near_truth(xyz, truth), truth)
            yield Answer(pair.trajectory, pixels, float(apart))
