"""The task `radarhd`: polar radar images to LiDAR occupancy, on real pairs.

The diffusion half of the main model alone: its network, sampler and loop, with another
prediction and loss. Samples are occupancy images of 0 and 1.

pairs     RadarHD's images, how the network takes them, and their rotation
model     the prediction, and the methods that draw images
scores    two protocols, and limits of occupied pixels
report    tables and pictures
describe  what makes weights a model for `jradar enhance`, and its reliability
"""

import math
from pathlib import Path

import jax
from ml_collections import ConfigDict

from experiments import build
from experiments.radarhd import report
from experiments.radarhd.describe import described, reliability_table
from experiments.radarhd.model import answers, build_spec, evaluated
from experiments.radarhd.pairs import (
    Alternating,
    PolarItems,
    RadarHD,
    open_radarhd,
)
from experiments.radarhd.scores import at_limits, choose_limits, score_pairs
from experiments.train import Training
from experiments.weights import initial_weights, start_from
from jradar import data, training
from jradar.errors import UsageError
from jradar.evaluation.scores import DISTANCES, F_SCORES
from jradar.files import write_text
from jradar.model import Model, save_model

LIMIT_FRAMES = 70  # on which limits are chosen, at most
SPARED = 10  # one in so many simulated trajectories is not trained on


def check(config: ConfigDict) -> None:
    """Raise UsageError for a config that cannot be trained."""
    build_spec(config)
    build.loss_of("polar", config.method)
    if not config.data.path:
        raise UsageError("no pairs: pass RadarHD's folder as --config.data.path")
    if config.data.simulated and config.data.history != 1:
        raise UsageError(
            f"data.history = {config.data.history}, expected 1 with data.simulated: "
            "each simulated image shows a place of its own"
        )
    initial_weights(config.train)


def setup(config: ConfigDict, workdir: Path) -> Training:
    """Return the network's training on the pairs of the other trajectories."""
    pairs = open_radarhd(config.data.path)
    train, checked = training_pairs(config, pairs), threshold_pairs(config, pairs)
    fields = {"history": config.data.history, "mirror": config.train.mirror}
    items: PolarItems | Alternating = PolarItems(train, **fields)
    trained_on = f"{len(train)} pairs"
    if config.data.simulated:
        simulated, _ = simulated_pairs(config)
        items = Alternating(items, PolarItems(simulated, **fields))
        trained_on += f" and {len(simulated)} simulated ones"
    varied = config.train.varied
    batches = data.Batches(
        range(len(items)) if varied else items,
        seed=config.seed,
        batch_size=config.train.batch_size,
        change=items.varied if varied else None,
    )
    spec = build_spec(config)
    optimizer = build.build_optimizer(config.train)
    first = items[0]
    state = training.create_state(
        build.random_key(config, build.INIT_KEY),
        spec.network,
        optimizer,
        image_shape=first.target.shape,
        condition_shape=first.condition.shape,
    )

    def validate(state, step):
        """Scores of the quickest method, at the best limit for these pairs."""
        drawn = answers(config, Model(state.ema_params, spec))
        quick = {"every": 8, "protocols": ("polar",), "methods": 1}
        rows = [*score_pairs(config, checked, drawn, **quick)]
        (found,) = report.summary(at_limits(rows, choose_limits(rows)))
        means = {name: found[name].mean for name in (*DISTANCES, *F_SCORES)}
        return means | {"empty": found["empty"] / found["frames"]}

    def save(state):
        """Write the model, its confidence fitted to pairs that it has not seen."""
        trained, spared = described_pairs(config, pairs)
        params = jax.device_get(state.ema_params)
        save_model(workdir / "model", described(config, params, spared, trained))

    return Training(
        state=start_from(config.train, spec.network, state),
        step=training.make_train_step(
            spec.network,
            optimizer,
            spec.noise,
            loss=build.loss_of("polar", config.method),
            ema_decay=config.train.ema_decay,
        ),
        batch_at=lambda step: training.Batch(*batches[step]),
        validate=validate,
        save=save,
        trained_on=trained_on,
        data_digest=train.digest,
    )


def training_pairs(config: ConfigDict, pairs: RadarHD) -> RadarHD:
    """Return the pairs that a network is trained on."""
    kept = (*config.data.threshold_trajectories, *config.data.report_trajectories)
    return pairs.of(kept, without=True)


def simulated_pairs(config: ConfigDict) -> tuple[RadarHD, RadarHD]:
    """Return the simulated pairs to train on, and those to fit the confidence to."""
    with build.section("data.simulated"):
        pairs = open_radarhd(config.data.simulated)
    spared = sorted({*pairs.keys[:, 0].tolist()})[::SPARED]
    return pairs.of(spared, without=True), pairs.of(spared)


def described_pairs(config: ConfigDict, pairs: RadarHD) -> tuple[list, list]:
    """Return the pairs that are trained on, and those that are not: real, simulated."""
    parts = [(training_pairs(config, pairs), threshold_pairs(config, pairs))]
    if config.data.simulated:
        parts.append(simulated_pairs(config))
    trained, spared = zip(*parts, strict=True)
    return [*trained], [*spared]


def threshold_pairs(config: ConfigDict, pairs: RadarHD) -> RadarHD:
    """Return the pairs on which limits are chosen."""
    with build.section("data.threshold_trajectories"):
        return pairs.of(config.data.threshold_trajectories)


def evaluate(config: ConfigDict, workdir: Path) -> None:
    """Choose limits, and score a model on the test pairs: tables and a report."""
    name = config.model or str(workdir)
    model = evaluated(name, config, method=config.method)
    drawn, every = answers(config, model), config.data.every
    pairs = open_radarhd(config.data.path)
    checked = threshold_pairs(config, pairs)
    spacing = math.ceil(len(checked) / LIMIT_FRAMES)
    rows = [*score_pairs(config, checked, drawn, every=max(every, spacing))]
    limits = choose_limits(rows)
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
    report.write_results(config, workdir, title, reported, drawn, limits)
    table = reliability_table(model, reported, range(0, len(reported), every))
    write_text(workdir / "evaluation" / "confidence.md", table)
    print(f"\nConfidence of the model:\n\n{table}")
