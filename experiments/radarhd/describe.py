"""What makes weights a model that `jradar enhance` takes, and whether one can trust it.

The confidence is fitted to pairs that the network was not trained on: a pixel is right
if the LiDAR has a point within 0.2 m of it. These pairs are of the training's building,
so they are also rotated, and their rooms made smaller and larger. There, a network's
answer disagrees with that to the mirror image, and is less often right. A network that
also trained on simulated pairs has a group of those that were spared. They alone have
the radar's points, to which the confidence of `plane_surroundings` is fitted.
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
    THRESHOLDS,
    Around,
    Judged,
    fitted_confidence,
    fitted_table,
    least_alone,
    least_confidence,
    markdown_table,
    mean_f_scores,
    spread,
)
from jradar.metrics import near_truth
from jradar.model import Card
from jradar.planar import (
    LIDAR,
    RADARHD,
    UNSCALED,
    Pixels,
    PlanarModel,
    PlanarSpec,
    both_ways,
    expected_f_score,
    fit_scaling,
    image_features,
    least_confidence as least_of,
    near_points,
    plane_surroundings,
    scaled,
)
from jradar.planar.evidence import AROUND
from jradar.planar.model import FAINT
from jradar.range_image import (
    IDENTITY,
    TrustTable,
    fit_trust,
    frequency,
)
from jradar.range_image.trust import LEAST_FRAMES
from jradar.types import PointCloud

FAINTEST = 1e-3  # expected F-score
MOST_IMAGES = 2000  # of training, which are described
FITTED_FRAMES = 40  # of each rotation and size
SIMULATED_FRAMES = 240
MOST_POINTS = PlanarSpec.points.capacity  # of the radar in a frame


class Answer(NamedTuple):
    """A trajectory, the pixels of its answer to one pair, and `disagreement`."""

    trajectory: int
    pixels: Judged
    disagreement: float


Groups = Sequence[Sequence[Answer]]


def described(
    config: ConfigDict, params: Any, spared: Sequence[RadarHD], trained: Sequence
) -> PlanarModel:
    """Return the model of parameters, its confidence fitted to the spared pairs.

    Real pairs come first in both, then simulated ones if any.
    """
    network, noise = networks(config)
    method = "nearness" if config.method == "nearness" else "occupancy"
    card = Card(
        purpose=config.purpose,
        steps_seen=config.train.steps,
        trained_on="RadarHD's dataset_5, whose licence is not stated"
        + ", and simulated pairs" * (len(trained) > 1),
        radars=(RADARHD,),
    )
    spec = PlanarSpec(network, noise, method=method, history=config.data.history)
    model = PlanarModel(params, spec, card, IDENTITY, trust_of(*trained))
    real, *simulated = spared
    index = spread(len(real), FITTED_FRAMES)
    with build.section("confidence"):
        places = [
            real.rotated(turn).scaled(size)
            for size in (1.0, *config.confidence.sizes)
            for turn in config.confidence.turns
        ]
    groups = [[*judged_answers(model, pairs, index)] for pairs in places]
    for pairs in simulated:
        index = spread(len(pairs), SIMULATED_FRAMES)
        groups.append([*judged_answers(model, pairs, index)])
    return with_scaled_confidence(model, groups)


def with_scaled_confidence(model: PlanarModel, groups: Groups) -> PlanarModel:
    """Return the model with a confidence that was fitted to groups of answers.

    Each group counts as much as another, and so it does for the share of the expected
    F-score that is left out. Without a pixel, the model stays as it is.
    """
    drawn = [group for group in groups if any(len(a.pixels.xyz) for a in group)]
    if not drawn:
        return model
    table = fitted_confidence(*([a.pixels for a in group] for group in drawn))
    model = dataclasses.replace(model, confidence=table, scaling=UNSCALED)
    pixels = (
        Pixels(confidence(a, model), a.pixels.right, a.disagreement)
        for a in itertools.chain(*drawn)
    )
    model = dataclasses.replace(model, scaling=fit_scaling([*pixels]))
    relative = ([_relative(answer, model) for answer in group] for group in drawn)
    model = dataclasses.replace(model, least_share=least_confidence(*relative))
    return with_echoes(model, groups)


def with_echoes(model: PlanarModel, groups: Groups) -> PlanarModel:
    """Return the model with what the radar's points say of a cloud, where known.

    The least confidence of the points around them is a share of their expected F-score,
    the one that scores best together with the pixels. Pixels away from those that are
    kept then need the highest confidence that costs no F-score.
    """
    heard = [[a for a in group if a.pixels.echoes is not None] for group in groups]
    kept = [[_kept(answer, model) for answer in group] for group in heard if group]
    around = [[frame.echoes for frame in group] for group in kept]
    if not any(len(each.xyz) for group in around for each in group):
        return dataclasses.replace(model, echoes=None)
    model = dataclasses.replace(model, echoes=fitted_table(around))
    joined = [[_joined(frame, model) for frame in group] for group in kept]
    scores = np.mean([mean_f_scores(group) for group in joined], axis=0)
    model = dataclasses.replace(model, echo_share=THRESHOLDS[int(scores.argmax())])
    joined = [[_next_to_kept(frame, model) for frame in group] for group in kept]
    alone = least_alone(*joined, least=THRESHOLDS[0])
    return dataclasses.replace(model, least_alone=alone)


def _kept(answer, model):
    """The pixels of an answer that become points."""
    said, pixels = confidence(answer, model), answer.pixels
    kept = said >= float(least_of(_padded(said), model.least_share))
    xyz, right = pixels.xyz[kept], pixels.right[kept]
    return pixels._replace(xyz=xyz, confidence=said[kept], right=right)


def _said(around, model):
    """The confidence of points around the radar's, and the F-score expected of them."""
    said = frequency(_padded(around.confidence), model.echoes)
    said = np.array(said) * (np.arange(len(said)) < len(around.xyz))
    return said[: len(around.xyz)], float(expected_f_score(jnp.asarray(said)))


def _joined(pixels, model):
    """Pixels as sure ones, and points around the radar's with relative confidences."""
    around = pixels.echoes
    said, expected = _said(around, model)
    sure = np.ones(len(pixels.xyz))
    parts = (
        (pixels.xyz, around.xyz),
        (sure, said / max(expected, FAINTEST)),
        (pixels.right, around.right),
    )
    return Judged(*map(np.concatenate, parts), pixels.truth)


def _next_to_kept(pixels, model):
    """Pixels, and as sure ones the points around the radar's that are kept.

    Also which pixels are near these.
    """
    around = pixels.echoes
    said, expected = _said(around, model)
    kept = said >= model.echo_share * expected
    xyz, right = around.xyz[kept], around.right[kept]
    added = PointCloud.from_xyz(_rows(xyz, AROUND * MOST_POINTS))
    near = near_points(_rows(pixels.xyz, math.prod(LIDAR.shape)), added)
    sure = np.ones(len(xyz), bool)
    parts = (
        (pixels.xyz, xyz),
        (pixels.confidence, sure),
        (pixels.right, right),
    )
    near = np.concatenate([np.asarray(near)[: len(pixels.xyz)], sure])
    return Judged(*map(np.concatenate, parts), pixels.truth, near)


def _relative(answer, model):
    """The pixels of an answer, with confidences relative to the expected F-score."""
    said = confidence(answer, model)
    expected = float(expected_f_score(_padded(said)))
    return answer.pixels._replace(confidence=said / max(expected, FAINTEST))


def confidence(answer: Answer, model: PlanarModel) -> np.ndarray:
    """Return the model's confidence in the pixels of an answer, from their values."""
    said = answer.pixels.confidence
    padded = _confidence(_padded(said), answer.disagreement, model)
    return np.asarray(padded)[: len(said)]


def _padded(values):
    """Values of pixels with zeros after them: one shape, compiled once."""
    padded = np.zeros(math.prod(LIDAR.shape), np.float32)
    padded[: len(values)] = values
    return jnp.asarray(padded)


def _rows(xyz, count):
    """Points with zeros after them, which are not valid: one shape, compiled once."""
    padded = np.zeros((count, 3), np.float32)
    padded[: len(xyz)] = xyz[:count]
    return jnp.asarray(padded)


@jax.jit
def _confidence(value, apart, model):
    return scaled(frequency(value, model.confidence), apart, model.scaling)


def reliability_table(model: PlanarModel, pairs: RadarHD, index: Sequence[int]) -> str:
    """Return Markdown: by building, how sure the model is of its pixels, and how right.

    Pixels that `plane_image` leaves out do not count. The last column is
    that of the same table of confidence without its scaling.
    """
    unscaled = dataclasses.replace(model, scaling=UNSCALED)
    seen: dict[str, list[tuple[np.ndarray, ...]]] = defaultdict(list)
    for answer in judged_answers(model, pairs, index):
        kept = [_kept(answer, each) for each in (model, unscaled)]
        parts = ((pixels.confidence, pixels.right) for pixels in kept)
        seen[building(answer.trajectory)].append(tuple(itertools.chain(*parts)))
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


def trust_of(*parts: RadarHD) -> TrustTable | None:
    """Return what radar images look like in training; None of too few."""
    features = [
        image_features(pairs.radar(i) / np.float32(255))
        for pairs in parts
        for i in spread(len(pairs), MOST_IMAGES)
    ]
    return fit_trust(np.stack(features)) if len(features) >= LEAST_FRAMES else None


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
            if pair.points is not None:
                pixels = pixels._replace(echoes=around(pair.points, truth))
            yield Answer(pair.trajectory, pixels, float(apart))


def around(points: np.ndarray, truth: np.ndarray) -> Around:
    """Return the points around the radar's, with their crowding as confidence."""
    found = plane_surroundings(PointCloud.from_xyz(_rows(points, MOST_POINTS)))
    valid = np.asarray(found.valid)
    xyz, said = (np.asarray(part)[valid] for part in (found.xyz, found.confidence))
    return Around(xyz, said, near_truth(xyz, truth))
