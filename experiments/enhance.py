"""The task `enhance`: train a model on records, and compare it with CFAR detectors.

The detectors' false-alarm rates are chosen on the validation split; the scores are of
the config's split.
"""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import jax
import numpy as np
from ml_collections import ConfigDict

from experiments import build
from experiments.train import Training
from experiments.weights import initial_weights, start_from
from jradar import data, training, viz
from jradar.errors import UsageError
from jradar.evaluation import (
    Method,
    MethodInput,
    RecordsInView,
    choose_rates,
    detector_methods,
    drawn,
    mean_scores,
    points_of,
    spread,
    trust_of,
    with_confidence,
    write_results,
)
from jradar.model import Model, Tables, load_model, save_model
from jradar.options.protocols import PROTOCOLS
from jradar.options.recordings import SPLITS
from jradar.radar import DETECTORS

FRAMES_IN_FIGURE = 4
ONE_ANSWER = {  # rows of methods that draw no samples, if not "jradar, METHOD"
    "regression": "direct regression",
    "marginal": "jradar, one pass",
}


def check(config: ConfigDict) -> None:
    """Raise UsageError for a config that cannot be trained."""
    build.build_network(config)
    build.build_images(config.image)
    build.build_solver(config)
    build.build_loss(config.loss, method=config.method)
    build.build_optimizer(config.train)
    build.build_augment(config)
    build.build_history(config)
    build.prepare_spec(config)
    initial_weights(config.train)
    for field, name, known in (
        ("split", config.evaluation.split, SPLITS),
        ("protocol", config.evaluation.protocol, PROTOCOLS),
        *(("detectors", name, DETECTORS) for name in config.evaluation.detectors),
    ):
        if name not in known:
            raise UsageError(
                f"evaluation.{field}: {name!r}, expected one of {[*known]}"
            )


def setup(config: ConfigDict, workdir: Path) -> Training:
    """Return the network's training on the records' pairs of images."""
    records = build.records_of(config, build.prepared_data(config, workdir), "train")
    history = build.build_history(config)
    checked = _groups(build.records_of(config, records.folder, "validation"), history)
    spec = build.build_spec(config, records)
    frames, fixed = (
        make(records, history) for make in (data.histories, data.fixed_histories)
    )
    digest = records.digest
    if config.data.views:
        views = data.Records(config.data.views, "train")
        frames, fixed = data.joined(frames, views), data.joined(fixed, views)
        checked.append(data.Records(config.data.views, "validation"))
        digest += views.digest
    pairs = data.pairs_of(spec, fixed)
    card, trust = build.build_card(config, records), trust_of(spec.frame_grid, pairs)
    optimizer = build.build_optimizer(config.train)
    state = training.create_state(
        build.random_key(config, build.INIT_KEY),
        spec.network,
        optimizer,
        image_shape=spec.grid.image_shape,
        condition_shape=spec.grid.condition_shape,
    )
    step = training.make_train_step(
        spec.network,
        optimizer,
        spec.noise,
        loss=build.build_loss(config.loss, method=config.method),
        ema_decay=config.train.ema_decay,
    )

    def validated(state, step):
        model = Model(state.ema_params, spec, Tables(trust=trust), card)
        path = workdir / "samples" / f"{step:06d}.png"
        return validate(config, model, checked[0], picture=path)

    def save(state):
        model = Model(jax.device_get(state.ema_params), spec, Tables(trust=trust), card)
        key = build.random_key(config, build.SAMPLE_KEY)
        save_model(workdir / "model", with_confidence(key, model, *checked))

    return Training(
        state=start_from(config.train, spec.network, state),
        step=step,
        batch_at=training.pair_batches(
            frames,
            spec.grid,
            build.build_augment(config),
            batch_size=config.train.batch_size,
            seed=config.seed,
            gap_pixels=config.image.gap_pixels,
        ),
        validate=validated,
        save=save,
        trained_on=f"{len(frames)} frames",
        data_digest=digest,
    )


def _groups(
    records: data.Records, history: data.HistorySpec
) -> list[Sequence[data.PreparedFrame]]:
    """Return frames as the history draws them, then those of each kind alone.

    A confidence that is fitted to all groups holds for each.
    """
    if history == data.HistorySpec():
        return [records]
    drawn = data.fixed_histories(records, history)
    alone = (
        dataclasses.replace(history, single=single, sparse=sparse)
        for single in (0.0, 1.0)
        for sparse in (0.0, 1.0)
    )
    return [drawn, *(data.fixed_histories(records, spec) for spec in alone)]


def validate(
    config: ConfigDict,
    model: Model,
    records: Sequence[data.PreparedFrame],
    *,
    picture: Path,
) -> dict[str, float]:
    """Return the scores of the model's default answer on validation frames.

    It is the last row of `model_methods`. A picture shows it next to the LiDAR's.
    """
    pairs = data.pairs_of(model.spec, records)
    index = spread(len(records), config.evaluation.frames_while_training)
    frames = [MethodInput(records[i], pairs[i]) for i in index]
    name, method = [*model_methods(config, model).items()][-1]
    key = build.random_key(config, build.SAMPLE_KEY)
    clouds = [method(jax.random.fold_in(key, i), f) for i, f in enumerate(frames)]
    fine, some = model.spec.frame_grid.view, range(min(FRAMES_IN_FIGURE, len(frames)))
    columns = {
        "LiDAR": np.stack([frames[i].pair.lidar for i in some]),
        name: np.stack([data.lidar_image(points_of(clouds[i]), fine) for i in some]),
    }
    viz.save_figure(viz.samples_figure(columns, fine), picture)
    truths = [frame.prepared.lidar_xyz for frame in frames]
    return mean_scores(map(points_of, clouds), truths)


def evaluate(config: ConfigDict, workdir: Path) -> None:
    """Score the workdir's model and the detectors: tables, pictures, a report."""
    model = load_model(workdir / "model")
    folder = build.prepared_data(config, workdir)
    records = build.records_of(config, folder, config.evaluation.split)
    view = RecordsInView(records, model.spec.frame_grid.view)
    rates = choose_rates(
        view,
        build.records_of(config, folder, "validation"),
        detectors=tuple(config.evaluation.detectors),
        frames=config.evaluation.frames_for_rates,
    )
    print(model.card.purpose, end="\n\n")
    pairs, methods = (
        data.pairs_of(model.spec, records),
        model_methods(config, model),
    )
    write_results(
        build.random_key(config, build.SAMPLE_KEY),
        workdir,
        view,
        pairs,
        {**detector_methods(view, rates), **methods},
        every=config.evaluation.every,
        protocol=config.evaluation.protocol,
    )


def model_methods(config: ConfigDict, model: Model) -> dict[str, Method]:
    """Return the rows of a model in the tables, its default answer last."""
    if (method := model.spec.method) != "diffusion":
        return {ONE_ANSWER.get(method, f"jradar, {method}"): drawn(model)}
    sampling, solver = config.sampling, build.build_solver(config)
    methods = {
        "one-step estimate": drawn(model, draws=1, steps=1, temperature=1.0),
        f"jradar, {sampling.solver.capitalize()} {sampling.steps}": drawn(
            model, draws=1, steps=sampling.steps, solver=solver
        ),
    }
    if sampling.draws > 1:
        methods[f"jradar, {sampling.draws} draws"] = drawn(model, draws=sampling.draws)
    return methods
