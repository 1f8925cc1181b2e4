"""The task `radarhd`: polar radar images to LiDAR occupancy, on real pairs.

The diffusion half of the main model alone: its network, sampler and loop, with another
prediction and loss. Samples are occupancy images of 0 and 1. A pixel is occupied where
it exceeds a limit, which is chosen for each method on trajectories kept for that.
"""

import functools
from collections.abc import Callable
from pathlib import Path

import numpy as np
from ml_collections import ConfigDict

from experiments import build
from experiments.radarhd.augment import AUGMENTATIONS, augmented
from experiments.radarhd.confidence import fit_confidence
from experiments.radarhd.methods import (
    draw_methods,
    fitting_weights,
    networks,
    quickest,
)
from experiments.radarhd.nearness import nearness_loss
from experiments.radarhd.occupancy import (
    occupancy_denoising_loss,
    occupancy_regression_loss,
)
from experiments.radarhd.pairs import (
    PolarItems,
    RadarHD,
    open_radarhd,
)
from experiments.radarhd.report import write_results
from experiments.radarhd.scores import (
    PROTOCOLS,
    at_limits,
    choose_limits,
    mean_scores,
    score_pairs,
)
from experiments.train import Training
from experiments.weights import initial_weights, start_from
from jradar import data, diffusion, training
from jradar.errors import UsageError

LOSSES = {
    "diffusion": occupancy_denoising_loss,
    "nearness": nearness_loss,
    "regression": occupancy_regression_loss,
}


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
    train, checked = pairs.without(kept), threshold_pairs(config, pairs)
    batches, trained_on = training_batches(config, train)
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
    state = start_from(config.train, network, state)

    def validate(state, step):
        method = quickest(draw_methods(config, state.ema_params))
        rows = [*score_pairs(config, checked, method, every=8)]
        return mean_scores(at_limits(rows, choose_limits(rows)))

    return Training(
        state=state,
        step=training.make_train_step(
            network,
            optimizer,
            noise,
            loss=LOSSES[config.method],
            ema_decay=config.train.ema_decay,
        ),
        batch_at=batches,
        validate=validate,
        save=lambda state: diffusion.write_params(
            workdir / "weights.safetensors", state.ema_params
        ),
        trained_on=trained_on,
        data_digest=train.digest,
    )


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
    batches = []
    for pairs, number in sources:
        if number:
            items = PolarItems(
                pairs, history=config.data.history, mirror=config.train.mirror
            )
            change = functools.partial(
                augmented, names=config.train.augment, others=items
            )
            batches += [
                data.Batches(items, seed=config.seed, batch_size=number, change=change)
            ]

    def batch_at(step):
        parts = [part[step] for part in batches]
        return training.Batch(*map(np.concatenate, zip(*parts, strict=True)))

    return batch_at, words


def evaluate(config: ConfigDict, workdir: Path) -> None:
    """Choose limits, and score the weights on the test pairs: table and picture."""
    for weights in (config.weights, config.nearness.weights):
        if weights and not Path(weights).is_file():
            raise UsageError(f"weights = {weights}: no such file")
    path = Path(config.weights or workdir / "weights.safetensors")
    params = fitting_weights(path, networks(config)[0], config.data.history)
    draws = draw_methods(config, params)
    pairs, every = open_radarhd(config.data.path), config.data.every
    checked = threshold_pairs(config, pairs)
    rows = [*score_pairs(config, checked, draws, every=every, protocols=PROTOCOLS)]
    limits = choose_limits(rows)
    confidence = fit_confidence(at_limits(rows, limits))
    if (Path(config.data.path) / "test").is_dir():
        reported = open_radarhd(config.data.path, split="test")
        where = "test trajectories"
    else:
        reported = pairs.of(config.data.report_trajectories)
        where = f"trajectories {config.data.report_trajectories}, not trained on"
    if config.data.turn:
        with build.section("data.turn"):
            reported = reported.turned(config.data.turn)
        where += f", turned by {config.data.turn:g} degrees"
    title = f"{config.purpose}; {where}"
    write_results(config, workdir, title, reported, draws, limits, confidence)


def threshold_pairs(config: ConfigDict, pairs: RadarHD) -> RadarHD:
    """Return the pairs on which limits are chosen."""
    with build.section("data.threshold_trajectories"):
        return pairs.of(config.data.threshold_trajectories)
