"""What makes weights a model that `jradar enhance` takes: their description.

The description also tells which radar images are unlike those of training.

The model answers in one pass. Its confidence is fitted to the pairs on which limits are
chosen: a pixel is right if the LiDAR has a point within 0.2 m of it.
"""

import functools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np
from ml_collections import ConfigDict

from experiments.radarhd.model import networks
from experiments.radarhd.pairs import RadarHD
from experiments.radarhd.scores import drawn_images, polar_points
from jradar.evaluation import Judged, fitted_confidence, near_truth, spread
from jradar.model import Card
from jradar.planar import (
    LIDAR,
    RADARHD,
    PlanarModel,
    PlanarSpec,
    describe_planar_model,
    image_features,
    one_pass,
)
from jradar.range_image import IDENTITY, TrustTable, fit_trust
from jradar.range_image.trust import LEAST_FRAMES

FAINT = 0.02  # value of a pixel that is never a point
MOST_IMAGES = 2000  # of training, which are described


def describe(
    config: ConfigDict,
    workdir: Path,
    weights: Path,
    params: Any,
    pairs: RadarHD,
    trained_on: RadarHD,
) -> Path:
    """Write the description of weights to the workdir; return its path."""
    network, noise = networks(config)
    method = "nearness" if config.method == "nearness" else "occupancy"
    spec = PlanarSpec(network, noise, method=method, history=config.data.history)
    card = Card(
        purpose=config.purpose,
        steps_seen=config.train.steps,
        trained_on="RadarHD's dataset_5, whose licence is not stated",
        radars=(RADARHD,),
    )
    draw = jax.jit(functools.partial(one_pass, network=network, noise=noise))
    frames = [*_judged(config, pairs, functools.partial(draw, params=params))]
    seen = any(len(frame.xyz) for frame in frames)
    table = fitted_confidence(frames) if seen else IDENTITY
    model = PlanarModel(params, spec, card, table, trust_of(trained_on))
    return describe_planar_model(weights, model, folder=workdir)


def trust_of(pairs: RadarHD) -> TrustTable | None:
    """Return what radar images look like in training; None of too few."""
    index = spread(len(pairs), MOST_IMAGES)
    features = [image_features(pairs.radar(i) / np.float32(255)) for i in index]
    return fit_trust(np.stack(features)) if len(index) >= LEAST_FRAMES else None


def _judged(config, pairs, draw) -> Iterator[Judged]:
    """The pixels of every `data.every`-th pair that are not faint."""

    def answers(key, condition):
        yield "one pass", draw(condition)

    index = range(0, len(pairs), config.data.every)
    for pair, _, image in drawn_images(config, pairs, answers, index):
        seen, truth = image > FAINT, polar_points(pair.lidar)
        if len(truth):
            xyz = LIDAR.xyz[seen]
            yield Judged(xyz, np.minimum(image[seen], 1), near_truth(xyz, truth), truth)
