"""The task `radarhd`: polar radar images to LiDAR occupancy, on real pairs.

The diffusion half of the main model alone: its network, sampler and loop, with another
prediction and loss. Samples are occupancy images of 0 and 1.

pairs        RadarHD's images, how the network takes them, and changes of them
simulated    a command that makes such pairs with the simulator
model        the prediction, the losses, and the methods that draw images
scores       two protocols, limits of occupied pixels, confidence
report       tables and pictures
"""

import functools
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from ml_collections import ConfigDict

from experiments import build
from experiments.radarhd import report
from experiments.radarhd.model import LOSSES, answers, fitting_weights, networks
from experiments.radarhd.pairs import (
    AUGMENTATIONS,
    PolarItems,
    RadarHD,
    augmented,
    open_radarhd,
)
from experiments.radarhd.scores import (
    at_limits,
    choose_limits,
    fit_confidences,
    score_pairs,
)
from experiments.train import Training
from experiments.weights import initial_weights, start_from
from jradar import data, diffusion, training
from jradar.errors import UsageError
from jradar.evaluation.scores import DISTANCES, F_SCORES
from jradar.files import write_text


def check(config: ConfigDict) -> None:
    """Raise UsageError for a config that cannot be trained."""
    networks(config)
    if config.method not in LOSSES:
        raise UsageError(f"method = {config.method!r}, expected one of {[*LOSSES]}")
    if not config.data.path:
        raise UsageError("no pairs: pass RadarHD's folder as --config.data.path")
    initial_weights(config.train)
    if unknown := set(config.train.augment) - set(AUGMENTATIONS):
        raise UsageError(
            f"train.augment = {config.train.augment}, without {sorted(unknown)[0]!r}: "
            f"expected names of {[*AUGMENTATIONS]}"
        )
    if not 0 <= config.data.simulated_share <= 1:
        raise UsageError(
            f"data.simulated_share = {config.data.simulated_share}, expected 0 to 1"
        )
    if config.data.simulated_share and not config.data.simulated:
        raise UsageError("no simulated pairs: pass them as --config.data.simulated")


def setup(config: ConfigDict, workdir: Path) -> Training:
    """Return the network's training on the pairs of the other trajectories."""
    pairs = open_radarhd(config.data.path)
    kept = (*config.data.threshold_trajectories, *config.data.report_trajectories)
    train, checked = pairs.of(kept, without=True), threshold_pairs(config, pairs)
    batch_at, trained_on = training_batches(config, train)
    network, noise = networks(config)
    optimizer = build.build_optimizer(config.train)
    first = PolarItems(train, history=config.data.history)[0]
    state = training.create_state(
        build.random_key(config, build.INIT_KEY),
        network,
        optimizer,
        image_shape=first.target.shape,
        condition_shape=first.condition.shape,
    )

    def validate(state, step):
        """Scores of the quickest method, at the best limit for these pairs."""
        drawn = answers(config, state.ema_params)
        quick = {"every": 8, "protocols": ("polar",), "methods": 1}
        rows = [*score_pairs(config, checked, drawn, **quick)]
        (found,) = report.summary(at_limits(rows, choose_limits(rows)))
        means = {name: found[name].mean for name in (*DISTANCES, *F_SCORES)}
        return means | {"empty": found["empty"] / found["frames"]}

    return Training(
        state=start_from(config.train, network, state),
        step=training.make_train_step(
            network,
            optimizer,
            noise,
            loss=LOSSES[config.method],
            ema_decay=config.train.ema_decay,
        ),
        batch_at=batch_at,
        validate=validate,
        save=lambda state: diffusion.write_params(
            workdir / "weights.safetensors", state.ema_params
        ),
        trained_on=trained_on,
        data_digest=train.digest,
    )


def threshold_pairs(config: ConfigDict, pairs: RadarHD) -> RadarHD:
    """Return the pairs on which limits are chosen."""
    with build.section("data.threshold_trajectories"):
        return pairs.of(config.data.threshold_trajectories)


def training_batches(
    config: ConfigDict, train: RadarHD
) -> tuple[Callable[[int], training.Batch], str]:
    """Return the function from a step to its batch, and what it holds in words.

    The share `data.simulated_share` of each batch are pairs of `data.simulated`.
    """
    size = config.train.batch_size
    simulated = round(size * config.data.simulated_share)
    sources, words = [(train, size - simulated)], f"{len(train)} pairs"
    if simulated:
        sources += [(open_radarhd(config.data.simulated), simulated)]
        words += f", and {len(sources[1][0])} simulated ones, {simulated} of {size}"

    def batches_of(pairs, number):
        history, mirror = config.data.history, config.train.mirror
        items = PolarItems(pairs, history=history, mirror=mirror)
        names = config.train.augment
        change = functools.partial(augmented, names=names, others=items)
        return data.Batches(items, seed=config.seed, batch_size=number, change=change)

    parts = [batches_of(*source) for source in sources if source[1]]

    def batch_at(step):
        found = zip(*(part[step] for part in parts), strict=True)
        return training.Batch(*map(np.concatenate, found))

    return batch_at, words


def evaluate(config: ConfigDict, workdir: Path) -> None:
    """Choose limits, and score the weights on the test pairs: tables and a report."""
    for weights in (config.weights, config.nearness.weights):
        if weights and not Path(weights).is_file():
            raise UsageError(f"weights = {weights}: no such file")
    path = Path(config.weights or workdir / "weights.safetensors")
    params = fitting_weights(path, networks(config)[0], config.data.history)
    drawn, every = answers(config, params), config.data.every
    pairs = open_radarhd(config.data.path)
    rows = [*score_pairs(config, threshold_pairs(config, pairs), drawn, every=every)]
    limits = choose_limits(rows)
    confidence = fit_confidences(at_limits(rows, limits))
    frequencies = {
        name: table.frequencies.tolist() for name, table in confidence.items()
    }
    text = json.dumps(frequencies, indent=2) + "\n"
    write_text(workdir / "evaluation" / "confidence.json", text)
    if (Path(config.data.path) / "test").is_dir():
        reported = open_radarhd(config.data.path, split="test")
        where = "test trajectories"
    else:
        reported = pairs.of(config.data.report_trajectories)
        where = f"trajectories {config.data.report_trajectories}, not trained on"
    if config.data.turn:
        with build.section("data.turn"):
            reported = reported.rotated(config.data.turn)
        where += f", rotated by {config.data.turn:g} degrees"
    title = f"{config.purpose}; {where}"
    report.write_results(config, workdir, title, reported, drawn, limits, confidence)
