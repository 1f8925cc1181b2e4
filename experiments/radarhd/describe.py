"""What makes weights a model that `jradar enhance` takes, and whether one can trust it.

The model answers in one pass. Its confidence is fitted to pairs that it was not trained
on: a pixel is right if the LiDAR has a point within 0.2 m of it. A network that has
seen a building is too sure of another one. So `confidence.description` takes the table
of a network that was trained without some rooms, and whose confidence was fitted to
them, plain and rotated (`confidence.trajectories`, `confidence.turns`).
"""

import dataclasses
import functools
from collections import defaultdict
from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from ml_collections import ConfigDict

from experiments import build
from experiments.radarhd.model import networks
from experiments.radarhd.pairs import RadarHD
from experiments.radarhd.scores import building, drawn_images, polar_points
from jradar.evaluation import (
    Judged,
    fitted_confidence,
    markdown_table,
    near_truth,
    spread,
)
from jradar.model import Card
from jradar.planar import (
    LIDAR,
    RADARHD,
    PlanarModel,
    PlanarSpec,
    image_features,
    load_planar_model,
    one_pass,
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


def described(
    config: ConfigDict, params: Any, pairs: RadarHD, trained_on: RadarHD
) -> PlanarModel:
    """Return the model of parameters; `pairs` are those that training had or spared."""
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
    return dataclasses.replace(model, confidence=_confidence(config, model, pairs))


def _confidence(config, model, pairs) -> ConfidenceTable:
    """The table of another model's description, or one that is fitted to pairs."""
    if config.confidence.description:
        return load_planar_model(config.confidence.description).confidence
    chosen = config.confidence.trajectories or config.data.threshold_trajectories
    with build.section("confidence"):
        spared = pairs.of(chosen)
        turned = [spared.rotated(turn) for turn in config.confidence.turns]
    groups = [[j for _, j in _judged(config, model, each)] for each in turned]
    groups = [group for group in groups if any(len(frame.xyz) for frame in group)]
    return fitted_confidence(*groups) if groups else IDENTITY


def reliability_table(config: ConfigDict, model: PlanarModel, pairs: RadarHD) -> str:
    """Return Markdown: by building, how sure the model is of its pixels, and how right.

    Pixels of less than the model's least confidence are left out.
    """
    seen: dict[str, list[tuple[np.ndarray, np.ndarray]]] = defaultdict(list)
    for trajectory, frame in _judged(config, model, pairs):
        said = np.asarray(frequency(jnp.asarray(frame.confidence), model.confidence))
        kept = said >= model.confidence.least
        seen[building(trajectory)].append((said[kept], frame.right[kept]))
    rows = []
    for place, frames in seen.items():
        said, right = map(np.concatenate, zip(*frames, strict=True))
        row = [place, f"{len(said):,}"]
        if len(said):
            mean, share = 100 * said.mean(dtype=float), 100 * right.mean()
            row += [f"{mean:.1f}", f"{share:.1f}", f"{mean - share:+.1f}"]
        rows.append(row + [""] * (5 - len(row)))
    columns = ["trajectories", "pixels", "confidence (%)", "right (%)", "too sure by"]
    return markdown_table(columns, rows)


def trust_of(pairs: RadarHD) -> TrustTable | None:
    """Return what radar images look like in training; None of too few."""
    index = spread(len(pairs), MOST_IMAGES)
    features = [image_features(pairs.radar(i) / np.float32(255)) for i in index]
    return fit_trust(np.stack(features)) if len(index) >= LEAST_FRAMES else None


def _judged(config, model, pairs) -> Iterator[tuple[int, Judged]]:
    """The pixels of every `data.every`-th pair that are not faint; its trajectory."""
    network, noise = model.spec.network, model.spec.noise
    draw = jax.jit(functools.partial(one_pass, network=network, noise=noise))

    def answers(key, condition):
        yield "one pass", draw(condition, params=model.params)

    index = range(0, len(pairs), config.data.every)
    for pair, _, image in drawn_images(config, pairs, answers, index):
        seen, truth = image > FAINT, polar_points(pair.lidar)
        if len(truth):
            xyz, said = LIDAR.xyz[seen], np.minimum(image[seen], 1)
            right = near_truth(xyz, truth)
            yield pair.trajectory, Judged(xyz, said, right, truth)
