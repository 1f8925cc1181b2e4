"""The task `enhance`: train the diffusion model on records, and compare it.

What is chosen by looking, the detectors' false-alarm rates, is chosen on the validation
split; the scores are those of the config's split.
"""

import sys
from pathlib import Path
from typing import Any

import jax
import numpy as np
from ml_collections import ConfigDict

from experiments.build import (
    INIT_KEY,
    SAMPLE_KEY,
    TRAIN_KEY,
    build_loss,
    build_network,
    build_optimizer,
    build_pairs,
    build_spec,
    check_mirror,
    check_workdir,
    initial_weights,
    prepared_data,
    start_from,
)
from experiments.evaluate import write_results
from experiments.studies.detectors import (
    Frame,
    Method,
    View,
    choose_rates,
    detector_methods,
    points_of,
)
from jradar import data, diffusion, training, viz
from jradar.baselines import regression_estimate
from jradar.bundle import Bundle, load_bundle, save_bundle
from jradar.metrics import compare_on_host
from jradar.pipeline import AGREEMENT, draw_range_image
from jradar.range_image import close_gaps, decode_target, encode_target, unproject

FRAMES_IN_FIGURE = 4


def run_training(config: ConfigDict, workdir: Path) -> None:
    """Train, save the bundle, evaluate it. Resumes where the workdir stands."""
    build_network(config)  # what is wrong with these shows before the data
    initial_weights(config.train)
    check_mirror(config)
    check_workdir(config, workdir)
    records = data.Records(prepared_data(config, workdir), "train")
    spec = build_spec(config, records)
    source = build_pairs(spec, records)
    batches = data.Batches(
        source,
        seed=config.seed,
        batch_size=config.train.batch_size,
        change=data.mirrored if config.train.mirror else None,
    )
    print(f"{len(records)} training frames", file=sys.stderr, flush=True)

    def encode(lidar):
        closed = close_gaps(lidar, reach=config.image.gap_pixels)
        return encode_target(closed, spec.fine, codec=spec.codec)

    first = source[0]
    optimizer = build_optimizer(config.train)
    state = training.create_state(
        # This generator compiles in half the time for a network's many parameters.
        jax.random.fold_in(jax.random.key(config.seed, impl="rbg"), INIT_KEY),
        spec.network,
        optimizer,
        image_shape=(*first.lidar.shape, 2),
        condition_shape=first.condition.shape,
    )
    state = start_from(config.train, spec.network, state)

    def batch_at(step):
        batch = batches[step]
        return training.Batch(batch.condition, np.asarray(encode(batch.lidar)))

    checked = data.Records(records.folder, "validation")

    def evaluate(state, step):
        return validate(config, Bundle(state.ema_params, spec), checked, workdir, step)

    state = training.train(
        jax.random.fold_in(jax.random.key(config.seed), TRAIN_KEY),
        state,
        training.make_train_step(
            spec.network,
            optimizer,
            spec.noise,
            loss=build_loss(config.loss, method=config.method),
            ema_decay=config.train.ema_decay,
        ),
        batch_at,
        steps=config.train.steps,
        workdir=workdir,
        checkpoint_every=config.train.checkpoint_every,
        evaluate_every=config.train.evaluate_every,
        evaluate=evaluate,
        best="chamfer",
    )
    if jax.process_index():
        return
    save_bundle(workdir / "bundle", Bundle(state.ema_params, spec))
    training.write_model_card(
        workdir,
        config=config.to_dict(),
        data_digest=records.digest,
        seed=config.seed,
        steps=config.train.steps,
        purpose=spec.purpose,
    )
    run_evaluation(config, workdir)


def validate(
    config: ConfigDict, bundle: Bundle, records: data.Records, workdir: Path, step: int
) -> dict[str, float]:
    """Scores of the quickest method on some validation frames, and a picture."""
    count = min(config.evaluation.frames_while_training, len(records))
    pairs = build_pairs(bundle.spec, records)
    index = np.linspace(0, len(records) - 1, count).astype(int).tolist()
    frames = [Frame(records[i], pairs[i]) for i in index]
    name, draw = next(iter(build_methods(config, bundle).items()))
    key = jax.random.fold_in(jax.random.key(config.seed), SAMPLE_KEY)
    clouds = [draw(jax.random.fold_in(key, i), f) for i, f in enumerate(frames)]
    scores = [
        compare_on_host(points_of(cloud), frame.prepared.lidar_xyz)
        for cloud, frame in zip(clouds, frames, strict=True)
    ]
    fine = bundle.spec.fine
    some = range(min(FRAMES_IN_FIGURE, count))
    columns = {
        "LiDAR": np.stack([frames[i].pair.lidar for i in some]),
        name: np.stack([data.lidar_image(points_of(clouds[i]), fine) for i in some]),
    }
    figure = viz.samples_figure(columns, fine)
    viz.save_figure(figure, workdir / "samples" / f"{step:06d}.png")
    nothing = 2 * fine.max_range_m  # the Chamfer distance where there is no cloud
    return {
        "chamfer": float(
            np.mean([np.nan_to_num(s.chamfer, nan=nothing) for s in scores])
        ),
        "f_score_0.2": float(np.mean([np.nan_to_num(s.f_score[1]) for s in scores])),
    }


def run_evaluation(config: ConfigDict, workdir: Path) -> None:
    """Score the workdir's bundle beside the detectors: tables, pictures, a report."""
    bundle = load_bundle(workdir / "bundle")
    folder = prepared_data(config, workdir)
    view = View(bundle.spec.radar, bundle.spec.fine)
    rates = choose_rates(
        view,
        data.Records(folder, "validation"),
        detectors=tuple(config.evaluation.detectors),
        frames=config.evaluation.frames_for_rates,
    )
    methods = {**detector_methods(view, rates), **build_methods(config, bundle)}
    records = data.Records(folder, config.evaluation.split)
    print(bundle.spec.purpose, end="\n\n")
    write_results(
        jax.random.fold_in(jax.random.key(config.seed), SAMPLE_KEY),
        workdir,
        view,
        records,
        build_pairs(bundle.spec, records),
        methods,
        every=config.evaluation.every,
    )


def build_methods(config: ConfigDict, bundle: Bundle) -> dict[str, Method]:
    """What a trained model draws, the quickest first: its rows of the tables."""
    if config.method == "regression":
        return {"direct regression": regressed(bundle)}
    steps, solver = config.sampling.steps, config.sampling.solver
    limit = bundle.spec.validity_threshold
    several = {**bundle.spec.sampling, **AGREEMENT, "draws": config.sampling.draws}
    methods = {
        "one-step estimate": sampled(bundle, validity_threshold=limit, steps=1),
        f"jradar, {solver.capitalize()} {steps}": sampled(
            bundle, **bundle.spec.sampling, steps=steps, solver=solver
        ),
    }
    if config.sampling.draws > 1:
        methods[f"jradar, {config.sampling.draws} draws"] = sampled(bundle, **several)
    return methods


def sampled(bundle: Bundle, **options: Any) -> Method:
    """The model's cloud, drawn with `options` of `draw_range_image`."""
    params, spec = bundle

    @jax.jit
    def cloud(key, condition):
        image = draw_range_image(
            key,
            condition,
            diffusion.conditional_denoiser(spec.network, params, spec.noise),
            fine=spec.fine,
            noise=spec.noise,
            codec=spec.codec,
            **options,
        )
        return unproject(image, spec.fine)

    return lambda key, frame: cloud(key, frame.pair.condition)


def regressed(bundle: Bundle) -> Method:
    """The cloud of a network that was trained by direct regression."""
    params, spec = bundle

    @jax.jit
    def cloud(condition):
        denoiser = diffusion.conditional_denoiser(spec.network, params, spec.noise)
        values = regression_estimate(
            denoiser(condition[None]), (1, *spec.fine.shape, 2), noise=spec.noise
        )
        image = decode_target(
            values[0],
            spec.fine,
            codec=spec.codec,
            validity_threshold=spec.validity_threshold,
        )
        return unproject(image, spec.fine)

    return lambda _, frame: cloud(frame.pair.condition)
