"""The task `rpdnet`: train RPDNet on records, and score it as a detector.

The network takes the place of a CFAR detector: the directions of its cells are found in
the same way. Its limit, the probability from which a cell counts, is chosen on the
validation split, as the detectors' false-alarm rates are. Detector and critic share one
training state, so that a run resumes where it stopped.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np
from ml_collections import ConfigDict

from experiments import build
from experiments.rpdnet.labels import LabelledMaps
from experiments.rpdnet.loss import make_rpdnet_step, rpdnet_params
from experiments.rpdnet.network import RPDNet, map_values
from experiments.train import Training
from experiments.weights import load_weights
from jradar import data, diffusion, training
from jradar.evaluation import (
    Method,
    RecordsInView,
    mean_scores,
    points_of,
    records_in_view,
    spread,
    write_results,
)
from jradar.evaluation.detectors import best_choice, seen_points
from jradar.files import read_json
from jradar.types import PointCloud

LIMITS = (0.05, 0.15, 0.25, 0.35, 0.5, 0.6, 0.7, 0.8, 0.9)  # of the probability
WEIGHTS = "weights.safetensors"
Probability = Callable[[np.ndarray], np.ndarray]  # of each cell, from a map of power


def check(config: ConfigDict) -> None:
    """Raise UsageError for a config that cannot be trained."""
    build_detector(config)


def build_detector(config: ConfigDict) -> RPDNet:
    """Return the network; its critic is fixed."""
    with build.section("network"):
        return RPDNet(**config.network)


def setup(config: ConfigDict, workdir: Path) -> Training:
    """Return the detector's training on maps that the LiDAR has labelled."""
    records = data.Records(build.prepared_data(config, workdir), "train")
    checked = data.Records(records.folder, "validation")
    items = LabelledMaps(records, min_snr_db=config.data.min_snr_db)
    batches = data.Batches(items, seed=config.seed, batch_size=config.train.batch_size)
    detector, optimizer = build_detector(config), build.build_optimizer(config.train)
    params = rpdnet_params(
        build.random_key(config, build.INIT_KEY), detector, items[0].condition.shape[:2]
    )
    return Training(
        state=training.state_of(params, optimizer),
        step=make_rpdnet_step(
            detector,
            optimizer,
            adversarial=config.train.adversarial,
            ema_decay=config.train.ema_decay,
        ),
        batch_at=lambda step: training.Batch(*batches[step]),
        validate=lambda state, _: validate(config, state.ema_params, checked),
        save=lambda state: diffusion.write_params(
            workdir / WEIGHTS, state.ema_params["detector"]
        ),
        trained_on=f"{len(items)} frames",
        data_digest=records.digest,
    )


def validate(
    config: ConfigDict, params: Any, records: data.Records
) -> dict[str, float]:
    """Return scores on some validation frames, at the best limit for these."""
    view = records_in_view(records)
    probability = cell_probability(config, params["detector"])
    count = config.evaluation.frames_while_training
    limit, score = choose_limit(view, probability, records, frames=count)
    frames = [records[i] for i in spread(len(records), count)]
    clouds = [marked_points(frame, view, probability, limit) for frame in frames]
    scores = mean_scores(map(points_of, clouds), [f.lidar_xyz for f in frames])
    return {"chamfer": scores["chamfer"], "f_score_0.2": score, "limit": limit}


def evaluate(config: ConfigDict, workdir: Path) -> None:
    """Score the workdir's weights on the config's split: tables and a report."""
    folder = build.prepared_data(config, workdir)
    records = data.Records(folder, config.evaluation.split)
    view = records_in_view(records)
    probability, limit = detector_of(workdir, data.Records(folder, "validation"))
    print(f"{config.purpose}\n\ncells of probability {limit} and more")
    write_results(
        build.random_key(config, build.SAMPLE_KEY),
        workdir,
        view,
        data.PairSource(records, view.fine, view.fine, num_slices=1),
        {"RPDNet": method_of(view, probability, limit)},
        every=config.evaluation.every,
    )


def detector_of(workdir: Path, checked: data.Records) -> tuple[Probability, float]:
    """Return the detector of a run, and its limit, which is best on `checked`."""
    config = ConfigDict(read_json(workdir / "config.json"))
    probability = cell_probability(config, load_weights(workdir / WEIGHTS))
    frames = config.evaluation.frames_for_limit
    view = records_in_view(checked)
    limit, _ = choose_limit(view, probability, checked, frames=frames)
    return probability, limit


def method_of(view: RecordsInView, probability: Probability, limit: float) -> Method:
    """Return the method that draws the points of the marked cells."""

    def method(key, frame):
        return marked_points(frame.prepared, view, probability, limit)

    return method


def cell_probability(config: ConfigDict, params: Any) -> Probability:
    """Return a function from a map of power to the probability of each of its cells."""
    logits = jax.jit(build_detector(config).apply)

    def probability(power):
        maps = map_values(np.asarray(power))[None, ..., None]
        found: Any = logits(params, maps)
        return np.asarray(jax.nn.sigmoid(found))[0, ..., 0]

    return probability


def marked_points(
    prepared: data.PreparedFrame,
    view: RecordsInView,
    probability: Probability,
    limit: float,
) -> PointCloud:
    """Return the points of the cells whose probability is at least `limit`."""
    power = np.asarray(data.cells_of(prepared).power)
    return seen_points(prepared, probability(power) >= limit, view)


def choose_limit(
    view: RecordsInView, probability: Probability, records: data.Records, *, frames: int
) -> tuple[float, float]:
    """Return the limit with the best mean F-score at 0.2 m, and that score."""
    prepared = [records[i] for i in spread(len(records), frames)]
    found = [probability(data.cells_of(frame).power) for frame in prepared]

    def clouds_at(limit):
        pairs = zip(prepared, found, strict=True)
        return [seen_points(frame, cells >= limit, view) for frame, cells in pairs]

    return best_choice(LIMITS, prepared, clouds_at)
